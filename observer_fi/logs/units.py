"""Whether the units of a log can be right for its rig: physics against the size of each channel.

A factor of a thousand is a wrong unit, not a fault; a note says so, because no filter says it as clearly.
Only too large values are judged: too small ones may come from a dead sensor or a lost coupling.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from observer_fi.physics import Model
from observer_fi.records import Array, Log, Segment

FEWEST = 20  # samples at full speed that a mean needs
PREFIXES = {1e3: "milli", 1e6: "micro"}
FAR = 3.0  # a ratio within this factor of a prefix is that prefix: effects and faults stay below


def suspect_units(log: Log, moves: tuple[Segment, ...], model: Model) -> tuple[str, ...]:
    """A note for every channel whose size a rig like `model` cannot produce; none is the usual answer."""
    notes = [*_drive_notes(log, model)] if model["Vmax"] > 0.0 and model["Km"] > 0.0 else []
    full = _at_full_speed(log, moves)
    if np.count_nonzero(full) >= FEWEST:
        w = float(np.abs(log.w_cmd[full]).mean())
        notes += _ratio_notes("voltage_v", np.abs(log.z[full, 0]), model["Km"] * w)
        notes += _ratio_notes("position_m", _steps(log, full), model["D"] * w / log.rate_hz)
    return tuple(notes)


def _drive_notes(log: Log, model: Model) -> Iterator[str]:
    top = _largest(log.w_cmd)
    if top > FAR * model["Vmax"] / model["Km"]:
        yield f"speed_cmd_rad_s reaches {top:.4g} rad/s, more than the supply can drive: is it in rpm?"
    most = 2.0 * model["Vmax"] / (model["Rm"] + model["Rs"])  # full reversal at full speed
    peak = _largest(log.z[:, 1])
    if peak > 10.0 * FAR * most:
        yield f"current_a reaches {peak:.4g} A, the supply drives at most {most:.2g} A: is it in mA?"


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def _at_full_speed(log: Log, moves: tuple[Segment, ...]) -> NDArray[np.bool_]:
    full = np.zeros(log.t.size, dtype=np.bool_)
    for move in moves:
        part = slice(move.start, move.stop)
        full[part] = np.abs(log.w_cmd[part]) > 0.99 * abs(move.peak)
    return full


def _steps(log: Log, full: NDArray[np.bool_]) -> Array:
    """Change of the position from a sample to the next, positive along the command, at full speed."""
    pairs = full[:-1] & full[1:]
    return (np.diff(log.z[:, 2]) * np.sign(log.w_cmd[:-1]))[pairs]


def _ratio_notes(column: str, seen: Array, expected: float) -> list[str]:
    known = seen[np.isfinite(seen)]
    ratio = float(known.mean()) / expected if known.size and expected > 0.0 else 0.0
    return [
        f"{column} is {ratio:.3g} times what the commanded speed gives: is its unit {prefix}...?"
        for factor, prefix in PREFIXES.items()
        if factor / FAR < ratio < factor * FAR
    ]
