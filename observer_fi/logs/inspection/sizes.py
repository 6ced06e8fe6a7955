"""Units by the size of values, and whether a column is a clock: what a header does not say."""

from typing import NamedTuple

import numpy as np

from observer_fi.logs.columns import COLUMNS
from observer_fi.logs.inspection.vocabulary import Header
from observer_fi.numerics import digits
from observer_fi.records import Array

# Beyond the first bound a value is unlikely in the unit itself, beyond the second impossible.
LARGE = {
    "current_a": (60.0, 300.0),
    "voltage_v": (400.0, 1000.0),
    "position_m": (3.0, 10.0),
    "position_cmd_m": (3.0, 10.0),
}
_SMALLER = {"A": ("A", "mA", "uA"), "V": ("V", "mV"), "m": ("m", "mm", "um")}
NOISY_M = 1e-3  # m: no position sensor has so much noise
RATES = (10.0, 1e5)  # samples a second that a logger has
USUAL_HZ = 1000.0
BACKWARD, UNEVEN = (
    1e-3,
    0.1,
)  # shares of intervals of a clock that may run backward, or be far from the median


class Steady(NamedTuple):
    """A column that increases steadily: the median step."""

    step: float


def unit_by_values(column: str, values: Array, header: Header) -> tuple[str, tuple[str, ...], str]:
    """A unit by the size of the values; which others they may be; why."""
    own = COLUMNS[column].unit
    known = values[np.isfinite(values)]
    top = (
        float(np.ptp(known))
        if column.startswith("position") and known.size
        else float(np.abs(known).max(initial=0.0))
    )
    if column in LARGE:
        return _by_size(own, top, noise_of(known) if own == "m" else 0.0, *LARGE[column])
    if column == "speed_cmd_rad_s":
        return (
            ("rpm", ("or rad/s",), f"reaches {digits(top, 4)}")
            if top > 700.0
            else ("rad/s", ("or rpm",), f"reaches {digits(top, 4)}")
        )
    if column == "pitch_deg":
        return (
            ("rad", ("or deg",), f"within {digits(top)}")
            if 0.0 < top < 0.5
            else ("deg", (), f"within {digits(top)}")
        )
    if column == "encoder_rad":
        return "rad", ("or deg, or rev",), "no unit"
    return own, ("or kN", "or kg, then factor 9.81") if column == "load_n" else ("or kN",), "no unit"


def noise_of(values: Array) -> float:
    """White noise or steps of a reading, from second differences."""
    return float(np.sqrt(np.median(np.diff(values, 2) ** 2) / 2.7)) if values.size > 8 else 0.0


def _by_size(
    own: str, top: float, noise: float, unlikely: float, impossible: float
) -> tuple[str, tuple[str, ...], str]:
    """The unit of which values of that size are believable: the largest, and the next where that is doubtful."""
    said = f"{'spans' if own == 'm' else 'reaches'} {digits(top)}"
    units = _SMALLER[own]
    for k, unit in enumerate(units[:-1]):
        size = top / 1000.0**k
        if noise / 1000.0**k > NOISY_M:
            said += f", noise {digits(noise, 2)}"  # so much in this unit is no sensor's
            continue
        if size <= unlikely:
            # a tenth of what would be unlikely may be the next unit as well: 20 mm, or 0.02 m
            return unit, ((f"or {units[k + 1]}",) if size > 0.1 * unlikely else ()), said
        if size <= impossible:
            return units[k + 1], (f"or {unit}",), said
    return units[-1], (), said


def steady(values: Array) -> Steady | None:
    """Whether a column increases steadily, as a clock does."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    if steps.size < 8:
        return None
    usual = float(np.median(steps))
    if not usual > 0.0 or np.mean(steps < 0.0) > BACKWARD:
        return None
    return Steady(usual) if np.mean(np.abs(steps - usual) > 0.6 * usual) <= UNEVEN else None


def time_unit(values: Array) -> tuple[str, tuple[str, ...], str]:
    """The unit that gives a rate which loggers have; of several the one nearest to the usual."""
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps)) if steps.size else 0.0
    if not step > 0.0:
        return "s", (), "no unit"
    per_second = {unit: 1.0 / (step * COLUMNS["time_s"].units[unit]) for unit in ("s", "ms", "us", "ns")}
    possible = {
        u: hz
        for u, hz in per_second.items()
        if RATES[0] <= hz * (1.0 + 1e-6) and hz <= RATES[1] * (1.0 + 1e-6)
    }
    if not possible:
        return "s", ("no unit gives a rate of 10 Hz to 100 kHz",), f"steps of {digits(step, 4)}"
    best = min(possible, key=lambda u: abs(np.log10(possible[u] / USUAL_HZ)) + (0.3 if u != "s" else 0.0))
    others = tuple(f"or {u} ({digits(hz, 4)} Hz)" for u, hz in possible.items() if u != best)
    return best, others, f"steps of {digits(step, 4)} are {digits(possible[best], 4)} Hz"
