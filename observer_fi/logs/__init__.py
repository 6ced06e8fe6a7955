"""Files and lines to logs, and logs to moves."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from observer_fi.logs.cleaning import NO_PITCH
from observer_fi.logs.columns import PLAIN, ColumnMap, columns_of, load_columns
from observer_fi.logs.command_recovery import (
    ABSENT,
    is_recovered,
    recover_command,
    with_command,
)
from observer_fi.logs.formats.registry import SHOWN_SUFFIXES, SUFFIXES
from observer_fi.logs.ingest import (
    CHUNK_ROWS,
    LogFile,
    Progress,
    log_from_frame,
    log_name,
    open_log,
    read_log,
)
from observer_fi.logs.line_parser import BrokenLineError, Clock, Parser, Row, Splitter, lines_of
from observer_fi.logs.logger.acquisition import (
    OFF_ZERO,
    SET_UP_DEG,
    STANDING,
    SWITCHED,
    acquisition_of,
    channel_traits,
    rests_for_noise,
    rests_of,
    stuck_from,
    undriven,
    with_logger,
    without_spikes,
)
from observer_fi.logs.logger.acquisition import SHORT as SHORTEST_REST
from observer_fi.logs.logger.clock import clock_of, even, on_its_clock
from observer_fi.logs.logger.hum import Hum, without_lines
from observer_fi.logs.logger.low_pass import (
    LowPass,
    LowPasses,
    Unfiltered,
    behind_steps,
    earlier,
    filtered_logger,
    timing_doubt,
    told_filter,
    unfiltered,
    with_low_passes,
)
from observer_fi.logs.logger.means import Mean, Unmeant, means_of, without_means
from observer_fi.logs.logger.noise_changes import NoiseChange, noise_change, shown_by
from observer_fi.logs.logger.readings import FEWEST_STEPS, Readings
from observer_fi.logs.logger.set_back import Lateness, SetBack, late_by
from observer_fi.logs.logger.winding import (
    Uninductive,
    change_rate,
    inductance_of,
    without_inductance,
    without_winding,
)
from observer_fi.logs.moves import (
    Excitation,
    Phase,
    excitation,
    log_phases,
    log_segments,
    mean_square_by_phase,
    moves_from_rest,
    phases,
    quarter_of_a_ring,
    quiet_speed,
    settling_time,
    turns_round,
)
from observer_fi.logs.plain_lines import numbers
from observer_fi.logs.position_speed import position_speed
from observer_fi.logs.thinned import Thinner, thinned
from observer_fi.logs.units import suspect_units

if TYPE_CHECKING:
    from observer_fi.logs.inspection.contents import Column, digest_of
    from observer_fi.logs.inspection.guesses import Guess
    from observer_fi.logs.inspection.inspection import Inspection, inspect_log, shown_range
    from observer_fi.logs.inspection.motion import Motion
    from observer_fi.logs.inspection.vocabulary import meaning, understood

__all__ = [
    "behind_steps",
    "SET_UP_DEG",
    "quarter_of_a_ring",
    "quiet_speed",
    "Lateness",
    "LowPass",
    "Mean",
    "Uninductive",
    "Unmeant",
    "change_rate",
    "inductance_of",
    "without_inductance",
    "without_winding",
    "means_of",
    "without_means",
    "LowPasses",
    "Unfiltered",
    "Thinner",
    "acquisition_of",
    "filtered_logger",
    "late_by",
    "timing_doubt",
    "told_filter",
    "unfiltered",
    "with_low_passes",
    "channel_traits",
    "clock_of",
    "rests_for_noise",
    "rests_of",
    "undriven",
    "stuck_from",
    "earlier",
    "even",
    "on_its_clock",
    "ABSENT",
    "NO_PITCH",
    "is_recovered",
    "position_speed",
    "BrokenLineError",
    "CHUNK_ROWS",
    "Clock",
    "Column",
    "ColumnMap",
    "Guess",
    "Inspection",
    "Hum",
    "LogFile",
    "Motion",
    "columns_of",
    "digest_of",
    "inspect_log",
    "meaning",
    "understood",
    "shown_range",
    "Excitation",
    "OFF_ZERO",
    "STANDING",
    "SHORTEST_REST",
    "SWITCHED",
    "NoiseChange",
    "noise_change",
    "shown_by",
    "FEWEST_STEPS",
    "PLAIN",
    "Parser",
    "Phase",
    "Progress",
    "Readings",
    "SetBack",
    "Row",
    "SHOWN_SUFFIXES",
    "SUFFIXES",
    "Splitter",
    "excitation",
    "lines_of",
    "load_columns",
    "log_from_frame",
    "log_name",
    "log_phases",
    "log_segments",
    "mean_square_by_phase",
    "moves_from_rest",
    "numbers",
    "open_log",
    "phases",
    "read_log",
    "recover_command",
    "settling_time",
    "suspect_units",
    "turns_round",
    "thinned",
    "with_command",
    "with_logger",
    "without_lines",
    "without_spikes",
]

# Imported when first used: only `inspect` looks at files as they are.
_LATER = {
    "contents": ("Column", "digest_of"),
    "guesses": ("Guess",),
    "inspection": ("Inspection", "inspect_log", "shown_range"),
    "motion": ("Motion",),
    "vocabulary": ("meaning", "understood"),
}
_MODULE_OF = {name: module for module, names in _LATER.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.inspection.{_MODULE_OF[name]}"), name)
