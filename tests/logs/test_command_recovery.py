"""A command that is recovered through loggers as they are: rests are rests, and starts are where they are."""

import hidden
import numpy as np
import pytest

from observer_fi.logs import log_from_frame, recover_command, with_command
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

SEEDS = range(7421, 7429)


@pytest.mark.parametrize(
    "trait", ["wandering", "coloured", "position_100hz", "drive_off", "noise_3", "steps_all"]
)
@pytest.mark.first(2)
def test_a_rest_behind_zero_offsets_is_one_whatever_else_the_logger_does(trait: str) -> None:
    """The offsets look like a slow motion; a position whose noise wanders, or that is held, seems to go on with it."""
    model = load_rig().model
    for seed in SEEDS:
        spec = hidden.draw_move_case(seed, "nominal")
        frame, _ = hidden.make_log_with(f"no_command+offsets+{trait}", spec, seed)
        log = recover_command(log_from_frame(frame), model)
        (move,) = spec.profile.moves
        assert "1 starts" in log.notes[-1], seed
        assert not log.w_cmd[log.t < move.start_s - 0.005].any() and log.w_cmd[-1] == 0.0, seed
        middle = float(np.median(log.w_cmd[np.abs(log.t - move.start_s - 0.5 * move.hold_s) < 0.2]))
        assert middle == pytest.approx(move.speed, rel=0.01), seed


@pytest.mark.slow
@pytest.mark.first(3)
@pytest.mark.parametrize("label", ["nominal", "overload", "coupling_loss"])
@pytest.mark.parametrize("seed", [99985640, 99985641, 99985643])
def test_a_bus_that_writes_a_row_a_message_tells_the_command(seed: int, label: str) -> None:
    """No row has both voltage and current; the refusal said that they were missing."""
    frame, _ = hidden.make_log(hidden.draw_move_case(seed, label), seed)
    rows = np.arange(len(frame))
    for k, column in enumerate(("voltage_v", "current_a", "position_m")):
        frame.loc[rows % 3 != k, column] = np.nan
    log = with_command(log_from_frame(frame.drop(columns="speed_cmd_rad_s")), load_rig())
    assert np.isnan(log.z[:, 0]).mean() == pytest.approx(2 / 3, abs=0.01), "the readings are as logged"
    assert np.mean((log.w_cmd != 0.0) == (frame["speed_cmd_rad_s"] != 0.0)) > 0.97
    verdict = diagnose_log(log, load_rig(), Settings()).isolation.verdict
    assert verdict.label == label or label in verdict.alike
