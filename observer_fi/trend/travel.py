"""Quantities of a log of current and position, from some 20 samples a second on: friction by direction, its slopes with
travel, speed and acceleration, the position loop, and what begins and ends a move.

While the mass moves one way, equation 1 is linear in what each sample of the torque Km i is made of. A logger that keeps only
the magnitude of the current gets its sign from the direction of motion: a screw that holds its load drives both ways.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.numerics import correlation_time, filled, runs
from observer_fi.physics import Rig
from observer_fi.records import Array, Log
from observer_fi.trend.digests import Curve

Mask = NDArray[np.bool_]

RATE_HZ = 50.0  # to which faster logs are averaged: friction, travel and loops are slower
SMOOTH_S = 0.3  # over which speed and acceleration are taken from the position
MOVING = 0.5  # of the usual speed: slower is a start, a stop or a rest
FEWEST = 20  # moving samples one way
EARLY_S, LATE_S = 0.36, 1.0  # after a move begins or ends: its peak, and the settling of a loop
REST_S = 1.0  # after which a loop is at rest
LONGEST = 4000  # samples of a curve along the travel that are kept
WAYS = {1: "forward", -1: "backward"}


class Series(NamedTuple):
    """A log averaged to an even clock: t s; x m; v m/s; a m/s^2; torque N m (signed); error m, NaN without a command.

    way: +1, -1 or 0 of the commanded motion, of the measured one where no command is logged; moving: how it moves
    steadily, 0 otherwise; load N; pitch deg; unsigned: whether the current is a magnitude; typical: usual speed m/s.
    """

    t: Array
    x: Array
    v: Array
    a: Array
    torque: Array
    magnitude: Array
    error: Array
    way: Array
    moving: Array
    load: Array
    pitch: Array
    unsigned: bool
    typical: float

    @property
    def step(self) -> float:
        """Between two samples [s]."""
        return float(self.t[1] - self.t[0])


Set = tuple[tuple[str, ...], tuple[str, ...], Array, Array]


def series_of(log: Log, rig: Rig) -> Series | str:
    """The log on an even clock, or why nothing can be told from it."""
    driving, constant = driving_of(log, rig)
    if driving is None or not (np.isfinite(driving).any() and np.isfinite(log.z[:, 2]).any()):
        return f"no {'current' if rig.driven.motor else 'force'} or no position was measured"
    factor = max(int(log.rate_hz / RATE_HZ), 1)
    t = even_clock(log)
    if t.size // factor < 2 * FEWEST:
        return "too short; record moves of some seconds"
    step = factor * (t[1] - t[0])
    channels = [np.interp(t, log.t, filled(c)) for c in (driving, *_channels(log))]
    i, x, load, pitch, cmd = (averaged(c, factor) for c in channels)
    t = averaged(t, factor)
    v, a = _slopes(x, step)
    fast = float(np.quantile(np.abs(v), 0.95))
    noise = float(np.std(np.diff(x, 3))) / np.sqrt(20.0)
    if fast * t.size * step < 10.0 * noise or fast <= 0.0 or np.ptp(x) < 10.0 * noise:
        return "the mass does not move; record moves in both directions"
    typical = float(np.median(np.abs(v)[np.abs(v) > 0.3 * fast]))
    known = log.position_cmd is not None
    goal_v = np.gradient(cmd, step) if known else v
    way = np.where(np.abs(goal_v) > MOVING * 0.5 * typical, np.sign(goal_v), 0.0)
    moving = np.where((np.abs(v) > MOVING * typical) & ((way == np.sign(v)) | (way == 0.0)), np.sign(v), 0.0)
    unsigned = bool(i.min() >= 0.0 and {1.0, -1.0} <= set(moving.tolist()))
    signed = i * (np.where(v < 0.0, -1.0, 1.0) if unsigned else 1.0)
    error = cmd - x if known else np.full(x.size, np.nan)
    return Series(
        t,
        x,
        v,
        a,
        constant * signed,
        constant * np.abs(i),
        error,
        way,
        moving,
        load,
        pitch,
        unsigned,
        typical,
    )


def driving_of(log: Log, rig: Rig) -> tuple[Array | None, float]:
    """What drives the mass, current (n,) [A] or force (n,) [N] as the rig has it, and its torque on the motor per unit [N m]."""
    return (log.z[:, 1], rig.model["Km"]) if rig.driven.motor else (log.force, rig.model["D"])


def _channels(log: Log) -> tuple[Array, ...]:
    none = np.zeros(log.t.size)
    load = none if log.load is None else log.load
    cmd = none if log.position_cmd is None else log.position_cmd
    return log.z[:, 2], load, log.pitch, cmd


def even_clock(log: Log) -> Array:
    """Times [s] as far apart as the log's samples are in the mean."""
    samples = round(float(log.t[-1] - log.t[0]) * log.rate_hz) + 1
    return np.linspace(log.t[0], log.t[-1], samples)


def averaged(y: Array, factor: int) -> Array:
    """Means of `factor` samples each."""
    return np.asarray(y[: y.size // factor * factor].reshape(-1, factor).mean(axis=1))


def _slopes(x: Array, step: float) -> tuple[Array, Array]:
    from scipy.signal import savgol_filter  # a second to import, for logs that are new

    size = max(2 * round(0.5 * SMOOTH_S / step) + 1, 5)
    return tuple(savgol_filter(x, size, 2, deriv=d, delta=step) for d in (1, 2))  # type: ignore[return-value]


# --- friction while the mass moves ----------------------------------------------------------------


def friction(s: Series, rig: Rig) -> tuple[list[Set], Curve | None]:
    """Friction of both directions: mean, half difference, slopes with travel and speed; and what these leave."""
    steady = steady_friction(s)
    if steady is None:
        return [], None
    used = steady.used
    theta, covariance, r = regression(steady.G, steady.torque)
    scale = np.ones(theta.size)
    scale[-1] = 1.0 / max(float(np.std(s.a[used])), 1e-30) * rig.model["D"]
    theta, covariance = theta * scale, covariance * np.outer(scale, scale)
    names = (*steady.names[:-1], "inertia")
    units = ("N m",) * (len(names) - 1) + ("kg m^2",)
    found = _both_ways((names, units, theta, covariance))
    keep = slice(None, None, max(r.size // LONGEST, 1))
    return [found], Curve(s.x[used][keep], (r * 1.0)[keep], s.moving[used][keep], s.step * (keep.step or 1))


class Steady(NamedTuple):
    """Torque (n,) N m of the samples `used` of a series that move steadily, and what it is regressed on: G (n, k), names (k,)."""

    used: Mask
    torque: Array
    names: tuple[str, ...]
    G: Array


def steady_friction(s: Series) -> Steady | None:
    """The smooth part of friction as a regression: by direction, with travel and speed, and acceleration; None at rest."""
    ways = [w for w in WAYS if np.count_nonzero(s.moving == w) >= FEWEST]
    used = np.isin(s.moving, ways)
    if not ways:
        return None
    centre, half = _travel(s.x[used])
    u = (s.x - centre) / half
    fast = (np.abs(s.v) - s.typical) / s.typical
    names, columns = [], []
    for w in ways:
        here = (s.moving == w).astype(float)
        names += [f"{n}_{WAYS[w]}" for n in ("friction", "travel_slope", "travel_curvature", "speed_slope")]
        columns += [here, here * u, here * (1.5 * u**2 - 0.5), here * fast]
    names.append("acceleration_torque")
    columns.append(s.moving * s.a / max(float(np.std(s.a[used])), 1e-30))
    return Steady(used, (s.torque * s.moving)[used], tuple(names), np.column_stack(columns)[used])


def _travel(x: Array) -> tuple[float, float]:
    low, high = np.quantile(x, (0.01, 0.99))
    return 0.5 * float(low + high), 0.5 * float(high - low)


def regression(G: Array, y: Array) -> tuple[Array, Array, Array]:
    """Least squares: coefficients, covariance widened by the residual's correlation, residual."""
    scale = np.maximum(np.linalg.norm(G, axis=0), 1e-300)
    inverse = np.linalg.pinv((G / scale).T @ (G / scale), rcond=1e-10)
    theta = inverse @ ((G / scale).T @ y)
    r = y - G / scale @ theta
    variance = float(r @ r) / max(y.size - theta.size, 1)
    covariance = inverse * variance * correlation_time(r, max(min(100, r.size // 4), 1))
    return theta / scale, covariance / np.outer(scale, scale), r


def _both_ways(found: Set) -> Set:
    """Friction of two directions as its mean A and half difference, where both were seen."""
    names, units, theta, covariance = found
    pair = ("friction_forward", "friction_backward")
    if not set(pair) <= set(names):
        return found
    T = np.eye(len(names))
    f, b = (names.index(n) for n in pair)
    T[f, [f, b]] = 0.5, 0.5
    T[b, [f, b]] = 0.5, -0.5
    new = tuple({f: "A", b: "torque_offset"}.get(k, n) for k, n in enumerate(names))
    return new, units, T @ theta, T @ covariance @ T.T


# --- what begins and ends a move, and rests --------------------------------------------------------


def events(s: Series) -> list[Set]:
    """Torque and position error after each start and stop, by direction: means over the events of a kind."""
    names: list[str] = []
    units: list[str] = []
    values: list[list[float]] = []
    wanted = max(round(LATE_S / s.step), 2)
    early = max(round(EARLY_S / s.step), 1)
    for row, kind in _events(s.way):
        if row + wanted > s.t.size:
            continue
        after = slice(row, row + early), slice(row + early, row + wanted)
        sign = 1.0 if kind.endswith("forward") else -1.0
        found = [(f"{kind}_torque", "N m", float(s.magnitude[after[0]].mean()))]
        found.append((f"{kind}_settling_torque", "N m", float(s.magnitude[after[1]].mean())))
        if np.isfinite(s.error).all():
            found.append((f"{kind}_lag", "m", sign * float(s.error[row : row + wanted].mean())))
        for name, unit, value in found:
            if name not in names:
                names.append(name)
                units.append(unit)
                values.append([])
            values[names.index(name)].append(value)
    if not names:
        return []
    mean = np.array([np.mean(v) for v in values])
    return [
        (
            tuple(names),
            tuple(units),
            mean,
            np.diag(_noise_of(names, s, early, wanted) / [len(v) for v in values]),
        )
    ]


def _events(way: Array) -> list[tuple[int, str]]:
    """Rows at which a move begins or ends, with what it is called. A log that begins in a move begins one."""
    found = []
    before = 0.0
    for row, now in enumerate(way.tolist()):
        if now != before:
            found.append((row, f"{'start' if now else 'stop'}_{WAYS[int(now or before)]}"))
        before = now
    return found


def _noise_of(names: list[str], s: Series, early: int, wanted: int) -> Array:
    """(k,) variance of a mean over a window, from the white part of torque and error."""
    torque = float(np.var(np.diff(s.magnitude, 2))) / 6.0
    error = float(np.var(np.diff(s.x, 2))) / 6.0
    size = {"_torque": early, "settling_torque": wanted - early, "_lag": wanted}
    return np.array([
        (error if n.endswith("_lag") else torque)
        / size["settling_torque" if n.endswith("settling_torque") else "_lag" if n.endswith("_lag") else "_torque"]
        for n in names
    ])  # fmt: skip


def loop(s: Series) -> list[Set]:
    """The position error while the mass moves steadily, and torque and error at rest: means, and their scatter as a logarithm."""
    parts: list[tuple[str, str, Array]] = []
    settled = _settled(s)
    rest = settled & (s.way == 0.0) & (np.abs(s.v) < 0.2 * s.typical)
    for w, name in WAYS.items():
        here = settled & (s.way == w) & (s.moving == w)
        if np.isfinite(s.error).all() and np.count_nonzero(here) >= FEWEST:
            parts.append((f"steady_error_{name}", "m", w * s.error[here]))
    if np.count_nonzero(rest) >= FEWEST:
        parts.append(("holding_torque", "N m", s.magnitude[rest]))
        if np.isfinite(s.error).all():
            parts.append(("holding_error", "m", s.error[rest]))
    if not parts:
        return []
    names = [n for n, _, _ in parts] + [f"{n}_scatter" for n, _, _ in parts]
    units = [u for _, u, _ in parts] + ["1"] * len(parts)
    spread = [float(np.std(y)) for _, _, y in parts]
    value = [float(y.mean()) for _, _, y in parts] + [float(np.log(max(d, 1e-300))) for d in spread]
    fewer = [correlation_time(y, max(min(50, y.size // 4), 1)) / y.size for _, _, y in parts]
    variance = [d**2 * f for d, f in zip(spread, fewer, strict=True)] + [0.5 * f for f in fewer]
    return [(tuple(names), tuple(units), np.array(value), np.diag(variance))]


def _settled(s: Series) -> Mask:
    """Samples of a stretch that has gone one way, or none, for `REST_S`."""
    found = np.zeros(s.t.size, dtype=np.bool_)
    wait = round(REST_S / s.step)
    for w in (-1.0, 0.0, 1.0):
        for a, b in zip(*runs(s.way == w), strict=True):
            found[min(a + wait, b) : b] = True
    return found


def conditions(s: Series) -> dict[str, float]:
    """What a log was recorded under: load, pitch, usual speed, where the travel lies and how long it is."""
    used = s.moving != 0.0
    centre, half = _travel(s.x[used]) if used.any() else (0.0, 0.0)
    return {
        "load_n": float(np.mean(s.load)), "pitch_deg": float(np.mean(s.pitch)), "speed_m_s": s.typical,
        "travel_centre_m": centre, "travel_m": 2.0 * half,
    }  # fmt: skip
