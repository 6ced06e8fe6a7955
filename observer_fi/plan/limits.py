"""What a rig may be asked to do: speed, acceleration, travel, time, and the pitches that are there."""

import math
from dataclasses import dataclass

from observer_fi.errors import UsageError
from observer_fi.logs import settling_time
from observer_fi.numerics import digits
from observer_fi.physics import DRIVES, Rig

_USUAL_SHARE = 0.6  # of the speed that the supply holds: the paper's rig runs at 410 of 690 rad/s, the rest is for starts
_LEAST_REST_S = 0.25  # a stop, and enough samples at rest before the next move
_SETTLED = 1.5  # times the settling time of the speed loop
_SECONDS = (2.0, 600.0)
_RATES_HZ = (20.0, 100_000.0)


@dataclass(frozen=True)
class Limits:
    """speed: of the motor, the highest that is commanded [rad/s]. accel: of the command [rad/s^2], infinite where it may jump.

    low, high: how far the mass may go from where a log begins [m], infinite where nobody says. pitches: levels that can be
    set [deg]. rest_s: what a stop takes. rate_hz: of the logger. unit: travel of the mass a radian [m/rad].
    """

    speed: float
    accel: float
    low: float
    high: float
    seconds: float
    pitches: tuple[float, ...]
    rest_s: float
    rate_hz: float
    unit: float


def limits_of(
    rig: Rig,
    seconds: float = 10.0,
    pitches: tuple[float, ...] = (0.0,),
    speed: float | None = None,
    travel: tuple[float, float] | None = None,
    rate_hz: float = 1600.0,
) -> Limits:
    """The limits of a rig, and of what its user allows. travel: lowest and highest position from the start of the log [m].

    Raises UsageError for a drive that cannot be simulated and for limits within which nothing moves.
    """
    if not rig.driven.servo:
        servos = " or ".join(f'"{row.name}"' for row in DRIVES.values() if row.servo)
        raise UsageError(
            f'rig {rig.name!r} has drive = "{rig.drive}": moves are planned by simulation, which needs a servo (drive = {servos})'
        )
    _check_range("--seconds", seconds, *_SECONDS)
    _check_range("--rate", rate_hz, *_RATES_HZ)
    if not pitches or not all(math.isfinite(p) and abs(p) <= 90.0 for p in pitches):
        raise UsageError(
            f"--pitches: levels from -90 to 90 deg are needed, got {', '.join(map(str, pitches)) or 'none'}"
        )
    low, high = _travel(rig, travel)
    rest = max(_LEAST_REST_S, _SETTLED * settling_time(rig.model))
    top = _top_speed(rig, pitches, speed)
    accel = rig.model["accel_cmd"] or math.inf
    return Limits(
        top, accel, low, high, seconds, tuple(dict.fromkeys(pitches)), rest, rate_hz, abs(rig.model["D"])
    )


def _check_range(option: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise UsageError(f"{option}: from {low:g} to {high:g}, got {value:g}")


def _top_speed(rig: Rig, pitches: tuple[float, ...], asked: float | None) -> float:
    """What the supply holds at the worst pitch [rad/s], a share of it, or what was asked for."""
    m = rig.model
    load = m["A"] + max(abs(m["B"] * p) for p in pitches)
    holds = (m["Vmax"] - (m["Rm"] + m["Rs"]) * load / m["Km"]) / m["Km"]
    if not holds > 0.0:
        raise UsageError(f"rig {rig.name!r}: {m['Vmax']:g} V of supply cannot move the mass at these pitches")
    if asked is None:
        return _USUAL_SHARE * holds
    if not 0.0 < asked <= holds:
        raise UsageError(
            f"--speed: the supply holds up to {digits(holds, 4)} rad/s at these pitches, got {asked:g}"
        )
    return asked


def _travel(rig: Rig, asked: tuple[float, float] | None) -> tuple[float, float]:
    low, high = rig.model["x_stop_low"], rig.model["x_stop_high"]
    if asked is not None:
        low, high = max(low, asked[0]), min(high, asked[1])
    if not (low <= 0.0 <= high and high > low):
        raise UsageError(
            f"--travel: {1e3 * low:g} to {1e3 * high:g} mm leaves no room around 0, where the log begins; give LOW:HIGH in mm"
        )
    return low, high
