"""Commanded moves and vehicle pitch against time."""

from dataclasses import dataclass, replace

import numpy as np

PITCH_BY_PAIR_DEG = (0.0, 10.0, -10.0, 5.0)


@dataclass(frozen=True)
class Move:
    """One trapezoid: leaves rest at start_s, begins to brake at start_s + hold_s. speed in rad/s, signed."""

    start_s: float
    speed: float
    hold_s: float

    @property
    def brake_s(self) -> float:
        return self.start_s + self.hold_s


@dataclass(frozen=True)
class Profile:
    """Moves, and a pitch [deg] of steps plus a slow sine. Before its first step it is that step.

    curve: the commanded speed as times [s] and speeds [rad/s], linear between them, in place of trapezoids; `moves` then
    only says where it moves.
    """

    moves: tuple[Move, ...]
    duration_s: float
    pitch_steps: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    pitch_wave_deg: float = 0.0
    pitch_wave_hz: float = 0.1
    pitch_wave_phase: float = 0.0
    curve: tuple[tuple[float, ...], tuple[float, ...]] | None = None


def command_at(profile: Profile, accel: float, times):
    """Trapezoid of section 2.2 [rad/s] at `times` [s], continuous in time, ramps of `accel` [rad/s^2]; or the curve."""
    return np.interp(times, *_corners(profile, accel))


def travel_at(profile: Profile, accel: float, times):
    """Integral of that command [rad]."""
    knots, speeds = _corners(profile, accel)
    grid = np.union1d(knots, times)
    w = np.interp(grid, knots, speeds)
    travel = np.concatenate(([0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(grid))))
    return np.interp(times, grid, travel)


def _corners(profile: Profile, accel: float):
    """Times [s] and speeds [rad/s] of its corners."""
    if profile.curve is not None:
        return profile.curve
    knots, speeds = [-1.0], [0.0]
    for move in profile.moves:
        ramp = abs(move.speed) / accel
        if move.start_s <= knots[-1] or ramp > move.hold_s:
            raise ValueError(
                f"{move} begins before the one before it has stopped, or is shorter than its ramp"
            )
        knots += [move.start_s, move.start_s + ramp, move.brake_s, move.brake_s + ramp]
        speeds += [0.0, move.speed, move.speed, 0.0]
    return knots, speeds


def pitch_at(profile: Profile, times):
    """Vehicle pitch [deg] at `times` [s]."""
    starts = np.array([start for start, _ in profile.pitch_steps])
    levels = np.array([level for _, level in profile.pitch_steps])
    step = levels[np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)]
    angle = 2 * np.pi * profile.pitch_wave_hz * np.asarray(times) + profile.pitch_wave_phase
    return step + profile.pitch_wave_deg * np.sin(angle)


def single_move(
    speed: float = 410.0,
    hold_s: float = 3.0,
    pitch_deg: float = 0.0,
    pitch_wave_deg: float = 0.0,
    pitch_wave_phase: float = 0.0,
    rest_before_s: float = 0.3,
    rest_after_s: float = 0.5,
) -> Profile:
    """Rest, one speed, stop, rest. A slow pitch of 0.4 deg is what a vehicle in the sea shows."""
    return Profile(
        (Move(rest_before_s, speed, hold_s),),
        rest_before_s + hold_s + rest_after_s,
        ((0.0, pitch_deg),),
        pitch_wave_deg,
        pitch_wave_phase=pitch_wave_phase,
    )


def there_and_back(speeds, holds_s, pitches_deg, first_start_s: float = 0.2, rest_s: float = 0.4) -> Profile:
    """For each speed a move forth and a move back, equally long; pitch steps in the rest before a pair."""
    moves, steps, start = [], [], first_start_s
    for speed, hold, pitch in zip(speeds, holds_s, pitches_deg, strict=True):
        steps.append((max(0.0, start - rest_s / 2), pitch))
        for sign in (1.0, -1.0):
            moves.append(Move(start, sign * speed, hold))
            start = round(start + hold + rest_s, 9)
    return Profile(tuple(moves), start - rest_s + 0.2, tuple(steps))


def campaign() -> Profile:
    """Eight moves in 20 s: +-410, +-205, +-300, +-410 rad/s at 0, 10, -10, 5 deg, rests of 0.4 s."""
    return there_and_back((410.0, 205.0, 300.0, 410.0), (2.0, 2.0, 2.0, 2.4), PITCH_BY_PAIR_DEG)


def rich_campaign() -> Profile:
    """Eighteen moves in 25 s: +-410, +-200, +-90 rad/s at each of 0, 10, -10 deg."""
    pitches = np.repeat((0.0, 10.0, -10.0), 3)
    return there_and_back((410.0, 200.0, 90.0) * 3, (1.0,) * 9, pitches)


def contact_campaign(pitch_deg: float = 0.0) -> Profile:
    """Six moves in 29 s that lean on the upper and the lower stop and come back, at 410 and 200 rad/s.

    With stops 0.5 mm to either side of the start the indentation reaches 1.3 mm, 7 mA of contact.
    """
    speeds, holds = (410.0, -410.0, 200.0), (4.0, 4.0, 6.0)
    return there_and_back(speeds, holds, (pitch_deg,) * 3)


FIRST_S, SHAPES = 0.3, (
    "short", "creeping", "slow", "soft_ramps", "s_curve", "sine", "staircase", "without_rests", "uneven",
)  # fmt: skip


def shaped_move(
    shape: str, speed: float, length_s: float, rng: np.random.Generator, **pitch: float
) -> Profile:
    """A move after `FIRST_S` of rest whose command has another shape than a trapezoid, and half a second of rest after it.

    shape: of `SHAPES`. speed: the highest [rad/s], signed. length_s: about how long it lasts; short ones last a fifth of it.
    pitch: as in `single_move`.
    """
    times, speeds = _SHAPED[shape](speed, length_s, rng)
    ends = times[-1]
    plain = single_move(speed, ends, rest_before_s=FIRST_S, **pitch)
    knots = (0.0, *(FIRST_S + times)), (0.0, *speeds)
    return replace(plain, curve=(tuple(map(float, knots[0])), tuple(map(float, knots[1]))))


def _ramped(levels, length_s, ramp_s):
    """Levels one after another, equally long, with ramps of ramp_s between them, from rest to rest."""
    each = length_s / len(levels)
    times, speeds, last = [0.0], [0.0], 0.0
    for k, level in enumerate((*levels, 0.0)):
        times += [k * each + 1e-6, k * each + ramp_s]
        speeds += [last, level]
        last = level
    return np.array(times), np.array(speeds)


def _smooth(function, length_s):
    at = np.arange(0.0, length_s, 5e-4)
    return np.append(at, length_s), np.append(function(at / length_s), 0.0)


def _s_curve(speed, length_s, rng):
    share = rng.uniform(0.1, 0.4)

    def at(u):
        rise = np.clip(np.minimum(u, 1.0 - u) / share, 0.0, 1.0)
        return speed * rise**2 * (3.0 - 2.0 * rise)

    return _smooth(at, length_s)


_QUICK_S = 0.007
_SHAPED = {
    "short": lambda v, s, rng: _ramped([v], 0.2 * s, _QUICK_S),
    "creeping": lambda v, s, rng: _ramped([0.03 * v], s, _QUICK_S),
    "slow": lambda v, s, rng: _ramped([0.15 * v], s, _QUICK_S),
    "soft_ramps": lambda v, s, rng: _ramped([v], s, rng.uniform(0.2, 0.8)),
    "s_curve": _s_curve,
    "sine": lambda v, s, rng: _smooth(
        lambda u: v * np.sin(2.0 * np.pi * round(2.0 + 4.0 * float(rng.uniform())) * u), s
    ),
    "staircase": lambda v, s, rng: _ramped([v * k / 5.0 for k in (1, 2, 3, 4, 5, 3, 1)], s, _QUICK_S),
    "without_rests": lambda v, s, rng: _ramped([v, -v, v, -v], s, 2.0 * _QUICK_S),
    "uneven": lambda v, s, rng: _ramped(
        [v * float(rng.uniform(0.2, 1.0)) for _ in range(6)], s, rng.uniform(0.01, 0.1)
    ),
}
