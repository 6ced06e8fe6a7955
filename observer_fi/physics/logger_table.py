"""What a logger does to its readings as a table of a rig file or a report, and back."""

import math
from collections.abc import Mapping
from typing import Any

from observer_fi.records import CHANNELS, Acquisition, ChannelTraits, Clock, Line

COLUMNS = {"voltage": "voltage_v", "current": "current_a", "position": "position_m"}
CLOCK = "clock"


def acquisition_table(acquisition: Acquisition | None) -> dict[str, Any]:
    """By column and of the clock, each in the unit of the column; None where there is no such trait, empty for None."""
    if acquisition is None:
        return {}
    traits = {COLUMNS[name]: getattr(acquisition, name) for name in CHANNELS}
    told = {column: _channel(c) for column, c in traits.items() if math.isfinite(c.noise_std)}
    clock = acquisition.clock
    return {**told, CLOCK: {"jitter_s": clock.jitter_s, "resolution_s": clock.resolution_s}}


def _channel(c: ChannelTraits) -> dict[str, Any]:
    return {
        "noise_std": c.noise_std, "as_white": c.as_white, "resolution": c.resolution, "update_hz": c.update_hz,
        "lines_hz": [line.hz for line in c.lines], "line_amplitudes": [line.amplitude for line in c.lines],
        "correlation_s": c.correlation_s, "spikes": c.spikes, "averaged_samples": c.averaged,
        "low_pass_hz": c.low_pass_hz, **({"late_s": c.late_s} if c.late_s else {}),
    }  # fmt: skip


def acquisition_from(table: Mapping[str, Any]) -> Acquisition | None:
    """The acquisition of such a table whose values were checked; None of an empty one. A channel without an entry is unknown."""
    if not table:
        return None
    voltage, current, position = (_traits(table.get(COLUMNS[name], {})) for name in CHANNELS)
    clock = table.get(CLOCK, {})
    return Acquisition(
        voltage, current, position, Clock(clock.get("jitter_s", 0.0), clock.get("resolution_s"), math.nan)
    )


def _traits(entry: Mapping[str, Any]) -> ChannelTraits:
    noise = entry.get("noise_std", math.nan)
    lines = zip(entry.get("lines_hz", ()), entry.get("line_amplitudes", ()), strict=False)
    return ChannelTraits(
        noise, entry.get("as_white", noise), entry.get("resolution"), entry.get("update_hz"),
        tuple(Line(hz, amplitude) for hz, amplitude in lines), entry.get("correlation_s"), entry.get("spikes", 0),
        entry.get("averaged_samples", 1), low_pass_hz=entry.get("low_pass_hz"),
        late_s=entry.get("late_s", 0.0),
    )  # fmt: skip


def without_nothing(table: Mapping[str, Any]) -> dict[str, Any]:
    """A table of tables without what is None or empty: TOML knows no such value."""
    kept = {
        key: {k: v for k, v in entry.items() if v is not None and not (isinstance(v, list) and not v)}
        for key, entry in table.items()
    }
    return {key: entry for key, entry in kept.items() if entry}
