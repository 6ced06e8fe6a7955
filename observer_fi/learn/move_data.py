"""Logs cut into moves, ready to be simulated open loop from the rest before each: the data side of every fit.

The servo makes the closed loop stable, so each move is run from rest with real stick-slip and compared with what was
measured. Two numbers per move are free: the current that holds the mass at rest and the mass position there.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy  # whose parts load when they are used: `signal` takes a second
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.learn.fit_readings import readings_to_fit, since_change
from observer_fi.learn.reversal_doubt import Doubt, doubt_of, no_doubt, subtract_doubt
from observer_fi.learn.servo.shown_position import as_followed
from observer_fi.logs import log_phases, moves_from_rest, with_command
from observer_fi.numerics import filled
from observer_fi.physics import Model, Rest, Rig, corners, quarters, speed
from observer_fi.physics import equations as a
from observer_fi.physics import simulation as s
from observer_fi.records import Array, Filter, Log, Segment

REST_S = 0.05  # of the rest before a move: enough samples for its starting point
TAIL_S = (
    0.15  # after the command is back at zero: the stop, without the long rest in which nothing new is said
)
FINE_S = (
    0.06  # after a corner of the command two integration steps a sample: saturation begins and ends there
)
REST_ROWS = 5  # of the same at least: a slow logger has that many in a fifth of a second
_COARSE_S = 1.5e-3  # between samples: more is not integrated in one step where a motor sticks and slips
SMOOTH_HZ = 2000.0  # knots a second of a command that is smooth between its samples
_UNKNOWN_PLAY = 1e-3  # m: nobody knows on which side the play is when a log begins
_PLAY_ROWS = 30  # samples after a log's first start in which the play may still be taken up
# Of the fastest speed and the largest current of a move, and times the change from one reading to the next: a "rest" that swings
# more is none, the loop rings or never stops.
_SWINGS, _SMOOTH = 0.1, 2.0
_NONE = 1e-3  # of the noise: next to no doubt at all
_REST_DOUBT = 2.0  # standard errors of the mean of a rest
_FIXED_POINT_STEPS = 8
_WORTH_LANES = 3  # models at once that cost less side by side than one after another
_PER_ROW = ("t", "theta", "z", "weight", "fine", "phase")
MOST_ROWS = 300_000  # samples of moves that are fitted at once: three minutes of motion at 1600 Hz


@dataclass(frozen=True)
class Experiment:
    """M moves of one or more logs, N samples in all, move m in rows bounds[m]:bounds[m + 1].

    t (N,) s on each log's clock; theta (N,) deg; z (N, 3) measured, 0 where missing; weight (N, 3) 1/std of the noise, 0
    where missing; fine (N,); phase (N,) `Phase` by the rig's model; log (M,) index of the log; start (M,) row of its log;
    peak (M,) rad/s and pitch (M,) deg; before (M,) direction of the move before, 0 for a log's first; rest (M, 2) current
    [A] and position [m] at rest; noise (3,). doubts: per move, what a reversal leaves open. knots: per log, times and
    values of the commanded speed, steeper than accel [rad/s^2] nowhere. history: per log, time and current on the whole log, for
    the slow states. at_rest: see `Drive`. hum_hz: lines of the logger. older_s: by which voltage and current may be older than
    their rows. silent: equations that are not simulated. driven (N,): the measured current that drives a simulation in place of a
    servo [A], empty where a servo does, read later than the rest by driven_late [s]. shown (N,): by which the angle that the
    position tells is ahead of the motor's in the model that such a simulation follows [rad].
    """

    t: Array
    theta: Array
    z: Array
    weight: Array
    fine: NDArray[np.bool_]
    phase: NDArray[np.int8]
    bounds: NDArray[np.int64]
    log: NDArray[np.int64]
    start: NDArray[np.int64]
    moving: NDArray[np.int64]
    peak: Array
    pitch: Array
    before: Array
    rest: Array
    noise: Array
    doubts: tuple[Doubt, ...]
    knots: tuple[tuple[Array, Array], ...]
    history: tuple[tuple[Array, Array], ...]
    accel: float
    at_rest: Callable[[Any, Array], Rest]
    steps: int = 2
    hum_hz: tuple[float, ...] = ()
    older_s: float = 0.0
    silent: tuple[str, ...] = ()
    driven: Array = field(default_factory=lambda: np.empty(0))
    driven_late: float = 0.0
    shown: Array = field(default_factory=lambda: np.empty(0))

    @property
    def moves(self) -> int:
        """Number of moves."""
        return self.peak.size

    @property
    def nuisance_std(self) -> Array:
        """(M, 2) how far the rest current [A] and position [m] may be from what was measured before the move."""
        rests = [slice(int(b), int(b + n)) for b, n in zip(self.bounds[:-1], self.moving, strict=True)]
        readings = np.array([(self.weight[rest, 1:] > 0.0).sum(axis=0) for rest in rests])
        std = _REST_DOUBT * self.noise[1:] / np.sqrt(np.maximum(readings, 1))
        # A drive that is off holds what it held before.
        std[readings[:, 0] == 0, 0] = float(np.abs(self.z[:, 1]).max())
        if self.driven.size:  # what drives a move is measured, and its beginning with it
            std[:, 0] = _NONE * self.noise[1]
            stands = np.array([np.ptp(self.z[rest, 2]) == 0.0 for rest in rests])
            std[stands, 1] = np.maximum(std[stands, 1], self.noise[2])
        std[self.before == 0.0, 1] = _UNKNOWN_PLAY
        return std

    @property
    def seen(self) -> list[int]:
        """Channels of which any reading counts."""
        return np.flatnonzero((self.weight > 0.0).any(axis=0)).tolist()

    @property
    def owner(self) -> NDArray[np.int64]:
        """(N,) the move that a row belongs to."""
        return np.repeat(np.arange(self.moves), np.diff(self.bounds))

    def rows(self, move: int) -> slice:
        """Rows of one move."""
        return slice(int(self.bounds[move]), int(self.bounds[move + 1]))

    def w_cmd(self, move: int) -> Array:
        """(n,) commanded speed at the rows of one move [rad/s]."""
        return np.interp(self.t[self.rows(move)], *self.knots[self.log[move]])


def samples_of(moves: Iterable[Segment]) -> int:
    """Samples in which something moves."""
    return sum(m.stop - m.start for m in moves)


def share_of(moves: Iterable[Sequence[Segment]], most: float = MOST_ROWS) -> float:
    """How much of the moves of several logs is taken where at most so many samples are."""
    return min(most / max(sum(map(samples_of, moves)), 1), 1.0)


def spread_moves(moves: Sequence[Segment], share: float) -> list[int]:
    """Numbers of the moves of one log that are taken, at least one: all, or a share of their samples, from everywhere.

    They are drawn, always alike: every second move of a log that goes to and fro would be one direction.
    """
    if share >= 1.0:
        return list(range(len(moves)))
    left = share * samples_of(moves)
    taken: list[int] = []
    for m in np.random.default_rng(0).permutation(len(moves)).tolist():
        left -= samples_of([moves[m]])
        if left >= 0.0 or not taken:
            taken.append(m)
    return sorted(taken)


def too_many_moves(logs: Sequence[Log], rig: Rig, most: int = MOST_ROWS) -> str:
    """What to say of logs with more moves than are fitted at once, "" of others."""
    if not rig.driven.motor or sum(log.t.size for log in logs) <= most:
        return ""
    moves = [moves_from_rest(with_command(log, rig)) for log in logs]
    share = share_of(moves, most)
    if share >= 1.0:
        return ""
    taken = sum(len(spread_moves(each, share)) for each in moves)
    return (
        f"{sum(map(len, moves))} moves are more than are fitted at once ({most} samples): {taken} of them, drawn from "
        "the whole of each log, are learned from"
    )


def prepare(
    logs: Sequence[Log],
    rig: Rig,
    moves: Sequence[Sequence[Segment]] | None = None,
    share: float | None = None,
    filters: Sequence[Filter] = (),
) -> Experiment:
    """Moves of several logs as one experiment. moves: per log, by default from `moves_from_rest`.

    filters: that were taken out of the readings.
    share: of the moves that is taken (`spread_moves`), by default what `MOST_ROWS` leaves room for.
    A move is used from at most `REST_S` before its start to `TAIL_S` after its stop. Raises InvalidLogError without moves.
    """
    cut = [moves_from_rest(log) for log in logs] if moves is None else moves
    accel = rig.model["accel_cmd"]
    steepest = max(float(np.max(np.abs(np.diff(log.w_cmd) / np.diff(log.t)), initial=0.0)) for log in logs)
    taken, noise, hum, jitter, older = readings_to_fit(logs, rig, filters)
    codes = [log_phases(log, rig.model) for log in logs]
    share = share_of(cut) if share is None else share
    every = [
        _part(log, new, k, m, segments, (noise, jitter[k]), rig.model, codes[k], dt)
        for k, (log, new, segments) in enumerate(zip(logs, taken, cut, strict=True))
        for dt in (float(np.median(np.diff(log.t))),)
        for m in spread_moves(segments, share)
    ]
    parts = [part for part in every if part is not None]
    if not parts:
        raise InvalidLogError(
            f"{logs[0].path}: no move that begins from a rest, nothing to fit; record moves, and the rest before each"
        )
    rows = [p["t"].size for p in parts]
    stacked: dict[str, Any] = {name: np.concatenate([p[name] for p in parts]) for name in _PER_ROW}
    each: dict[str, Any] = {
        name: np.array([p[name] for p in parts])
        for name in ("log", "start", "moving", "peak", "pitch", "before", "rest")
    }
    return Experiment(
        **stacked,
        **each,
        bounds=np.concatenate(([0], np.cumsum(rows))).astype(np.int64),
        noise=noise,
        hum_hz=hum,
        older_s=older,
        doubts=tuple(p["doubt"] for p in parts),
        knots=tuple(knots_of(log, rig) for log in taken),
        history=tuple((log.t, np.nan_to_num(filled(log.z[:, 1]))) for log in logs),
        accel=accel or steepest,
        at_rest=rig.driven.at_rest,
    )


def knots_of(log: Log, rig: Rig) -> tuple[Array, Array]:
    """Knots (K,) [s] of the command through the samples of a log, and (K,) there [rad/s]: a trapezoid, or what a loop makes of a
    smooth goal and encoder.

    A line between the samples of the latter loses (ring * interval)^2 / 12 of what the loop rings, 2 % at 4 ms and 18 Hz.
    """
    pieces = math.ceil(SMOOTH_HZ / log.rate_hz)
    if rig.driven.command is None:
        return corners(log.t, log.w_cmd, rig.model["accel_cmd"])
    if pieces < 2:
        return log.t, log.w_cmd
    rows = np.arange(pieces * (log.t.size - 1) + 1) / pieces
    t = np.interp(rows, np.arange(log.t.size), log.t)
    return t, scipy.interpolate.Akima1DInterpolator(log.t, log.w_cmd, method="makima")(t)


def select(experiment: Experiment, moves: Sequence[int]) -> Experiment:
    """The experiment with some of its moves only, in the given order."""
    rows = np.concatenate([np.arange(experiment.bounds[m], experiment.bounds[m + 1]) for m in moves])
    sizes = [int(experiment.bounds[m + 1] - experiment.bounds[m]) for m in moves]
    k = np.asarray(moves)
    return replace(
        experiment,
        **{name: getattr(experiment, name)[rows] for name in (*_PER_ROW, *_of_a_loop(experiment))},
        **{
            name: getattr(experiment, name)[k]
            for name in ("log", "start", "moving", "peak", "pitch", "before", "rest")
        },
        bounds=np.concatenate(([0], np.cumsum(sizes))).astype(np.int64),
        doubts=tuple(experiment.doubts[m] for m in moves),
    )


def _of_a_loop(experiment: Experiment) -> tuple[str, ...]:
    """Fields with a number per row that only moves behind a loop have."""
    return ("driven", "shown") if experiment.driven.size else ()


def openings(experiment: Experiment, seconds: float) -> Experiment:
    """The experiment with the rest and the first seconds of every move only; what reversals leave open is left out."""
    begins = experiment.t[experiment.bounds[:-1] + experiment.moving]
    kept = experiment.t < begins[experiment.owner] + seconds
    sizes = np.bincount(experiment.owner[kept], minlength=experiment.moves)
    return replace(
        experiment,
        **{name: getattr(experiment, name)[kept] for name in (*_PER_ROW, *_of_a_loop(experiment))},
        bounds=np.concatenate(([0], np.cumsum(sizes))).astype(np.int64),
        doubts=tuple(no_doubt(size) for size in sizes.tolist()),
    )


def whitened(experiment: Experiment, r: Array) -> Array:
    """Normalised residuals or columns (N, 3), or (k, N, 3) of them, changed in place: less what a reversal leaves open."""
    for m, doubt in enumerate(experiment.doubts):
        subtract_doubt(r[..., experiment.rows(m), :], doubt)
    return r


def unwhitened(experiment: Experiment, r: Array) -> Array:
    """Normalised residuals or columns (N, 3) as they were before `whitened`."""
    r = r.copy()
    for m, doubt in enumerate(experiment.doubts):
        subtract_doubt(r[experiment.rows(m)], doubt._replace(share=-doubt.share / (1.0 - doubt.share)))
    return r


def _part(
    log: Log,
    taken: Log,
    number: int,
    m: int,
    segments: Sequence[Segment],
    doubt: tuple[Array, Array],
    model: Model,
    phase: NDArray[np.int8],
    dt: float,
) -> dict | None:
    """One move as rows of an experiment, or None where it has no rest to start from. taken: readings that count.

    doubt: their noise, and the jitter of their times [s], (3,) each.
    """
    segment = segments[m]
    rest = max(segment.rest, segment.start - max(round(REST_S / dt), REST_ROWS), 0)
    end = min(segment.end, segment.stop + round(TAIL_S / dt), log.t.size)
    still = log.z[rest : segment.start]
    if segment.start - rest < 4 or np.isnan(still[:, 1:]).all(axis=0).any():
        return None
    if _swings(log.z[rest:end], segment.start - rest, model):
        return None
    t, z = taken.t[rest:end], taken.z[rest:end]
    missing = np.isnan(z)
    gapless = np.nan_to_num(np.stack([filled(channel) for channel in log.z[rest:end].T], axis=1))
    weight = np.where(missing, 0.0, 1.0 / np.hypot(doubt[0], doubt[1] * np.gradient(gapless, t, axis=0)))
    if m == 0:
        weight[: segment.start - rest + _PLAY_ROWS, 2] = 0.0
    since = since_change(t, log.w_cmd[rest:end])
    brake = segment.stop - rest - int(abs(segment.peak) / (model["accel_cmd"] or math.inf) / dt) - 2
    return {
        "t": t,
        "theta": np.nan_to_num(log.pitch[rest:end]),
        "z": np.where(missing, 0.0, z),
        "weight": weight,
        "fine": (since < FINE_S) | (np.gradient(t) > _COARSE_S),
        "phase": phase[rest:end],
        "log": number,
        "start": rest,
        "moving": segment.start - rest,
        "peak": segment.peak,
        "pitch": segment.pitch,
        "before": float(np.sign(segments[m - 1].peak)) if m else 0.0,
        "rest": np.nanmean(still[:, 1:], axis=0),
        "doubt": doubt_of(t, gapless, weight, brake, model),
    }


def _swings(z: Array, rows: int, model: Model) -> bool:
    """Whether motor and current swing in the first rows of the readings z (n, 3) of a move, which should be its rest.

    Noise scatters from one reading to the next, and hum is little beside a start: neither is a swing.
    """
    both = np.column_stack([speed(z, model.vector), z[:, 1]])
    still = both[:rows][np.isfinite(both[:rows]).all(axis=1)]
    if not still.size:
        return False
    low, high = np.quantile(still, (0.25, 0.75), axis=0)  # without spikes
    rough = np.median(np.abs(np.diff(still, axis=0)), axis=0)
    return bool((high - low > np.maximum(_SWINGS * np.nanmax(np.abs(both), axis=0), _SMOOTH * rough)).all())


def _slow_start(experiment: Experiment, p: Array) -> tuple[Array, Array]:
    """(M,) relative resistance rise and sag [V] at the start of every move, from the current measured before it."""
    h, sag = np.zeros(experiment.moves), np.zeros(experiment.moves)
    if p[a.EXTENDED] == 0.0:
        return h, sag
    for k, (t, i) in enumerate(experiment.history):
        dt = float(np.median(np.diff(t)))
        here = experiment.log == k
        rows = experiment.start[here]
        if p[a.HEATING_RISE] != 0.0:
            h[here] += p[a.HEATING_RISE] * (1.0 - np.exp((t[0] - t[rows]) / p[a.HEATING_TIME]))
        if p[a.HEATING_GAIN] != 0.0:
            noise = experiment.noise[1] ** 2  # the mean square of the noise is not heat
            h[here] += p[a.HEATING_GAIN] * p[a.RM] * _leaky(i * i - noise, dt, p[a.HEATING_TIME])[rows]
        if p[a.SAG_RESISTANCE] != 0.0:
            sag[here] = p[a.SAG_RESISTANCE] / p[a.SAG_TIME] * _leaky(np.abs(i), dt, p[a.SAG_TIME])[rows]
    return h, sag


def _leaky(u: Array, dt: float, time: float) -> Array:
    """Integral of u that leaks with a time constant [u s]: the value before each sample is added."""
    decay = math.exp(-dt / time)
    total = scipy.signal.lfilter([dt], [1.0, -decay], u)
    return np.concatenate(([0.0], total[:-1]))


def commands(experiment: Experiment, p: Array) -> tuple[Array, Array]:
    """Command, and command as the servo's proportional path sees it, at the quarters of every interval, (N, 4) each."""
    delay, late, accel, ahead = _delays(p)
    now = _commands(experiment, delay, accel, ahead)
    return now, (_commands(experiment, delay + late, accel, ahead) if late else now)


def _delays(p: Array) -> tuple[float, float, float, float]:
    """What of a parameter vector changes the commands: delay, delay of the proportional path [s], limit [rad/s^2], planned."""
    if p[a.EXTENDED] == 0.0:
        return 0.0, 0.0, math.inf, 0.0
    limit, ahead = float(p[a.ACCEL_LIMIT]), float(p[a.ACCEL_AHEAD])
    return float(p[a.INPUT_DELAY] + p[a.TICK_PHASE]), float(p[a.SERVO_DELAY]), limit, ahead


def _commands(experiment: Experiment, delay: float, accel: float, ahead: float) -> Array:
    parts = []
    for m in range(experiment.moves):
        knots, values = experiment.knots[experiment.log[m]]
        t = experiment.t[experiment.rows(m)]
        k0 = max(int(np.searchsorted(knots, t[0] - max(delay, 0.0))) - 2, 0)
        k1 = int(np.searchsorted(knots, t[-1] - min(delay, 0.0))) + 2
        parts.append(quarters(t, knots[k0:k1], values[k0:k1], delay, accel, ahead))
    return np.concatenate(parts)


def simulate(
    experiment: Experiment, model: Model, nuisance: Array, ready: tuple[Array, Array] | None = None
) -> Array:
    """Readings (N, 3) of the model over every move: V, i, x.

    nuisance: (M, 2) what to add to the measured rest current [A] and rest position [m]. ready: `commands` for the
    same delays, where they are at hand.
    """
    return run(experiment, model, nuisance, ready)[1]


def run(
    experiment: Experiment, model: Model, nuisance: Array, ready: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """States (N, COLUMNS) with the columns of `simulate.run`, and readings (N, 3)."""
    states, y = run_alone(experiment, model, nuisance, ready)
    if experiment.driven.size:
        for rows in map(experiment.rows, range(experiment.moves)):
            as_followed(experiment.t[rows], states[rows], model, experiment.shown[rows], y[rows])
    return states, y


def run_alone(
    experiment: Experiment, model: Model, nuisance: Array, ready: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """As `run`, but of a loop that has followed the motor of this model, wherever its sensor shows the mass."""
    p = model.vector
    now, late = commands(experiment, p) if ready is None else ready
    states = np.empty((experiment.t.size, s.COLUMNS))
    y = np.empty((experiment.t.size, 3))
    starts = _starts(experiment, p, nuisance)
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        t = experiment.t[rows]
        ahead = 0.0
        if m:
            _carry_play(experiment, m, p, starts, states[rows.start - 1])
            ahead = _ahead(experiment, m, p, states[rows.start - 1, s.MASS], y[rows.start - 1, 2])
            _moved(starts[m], ahead, p)
        s.run(
            t,
            now[rows],
            late[rows],
            experiment.fine[rows],
            experiment.theta[rows],
            p,
            starts[m],
            states[rows],
            experiment.steps,
        )
        show(t, states[rows], late[rows], p, y[rows])
        _show_late(t, y[rows], ahead, p)
    return states, y


def show(t: Array, states: Array, late: Array, p: Array, y: Array) -> None:
    """Into y (n, 3): what the sensors show of states (n, COLUMNS), of a servo that holds its current. late: see `commands`."""
    s.readings(t, states, p, y)
    age = float(p[a.TICK_SHARE] * p[a.SERVO_DELAY])
    if p[a.EXTENDED] != 0.0 and age != 0.0:
        s.age(t, states, late, np.full(t.size, age), p, y)


def _carry_play(experiment: Experiment, m: int, p: Array, starts: Array, last: Array) -> None:
    """Into the start of move m: the stop before leaves the play somewhere between its ends. last: the states there."""
    if experiment.log[m] == experiment.log[m - 1]:
        play = p[a.BACKLASH] != 0.0
        x = starts[m, s.MASS] + last[s.X] - last[s.MASS]
        starts[m, s.X] = np.where(play, x, starts[m, s.X])
        starts[m, s.PHI] = np.where(play, x / p[a.D], starts[m, s.PHI])


def _ahead(experiment: Experiment, m: int, p: Array, mass: float, shown: float) -> float:
    """How far the mass is ahead of what a sensor that lags shows as move m starts [m].

    mass, shown: where it was, and the reading, at the end of the move before.
    """
    lag = float(p[a.POSITION_LAG])
    if lag == 0.0 or experiment.log[m] != experiment.log[m - 1]:
        return 0.0
    since = experiment.t[experiment.bounds[m]] - experiment.t[experiment.bounds[m] - 1]
    return (mass - shown / float(p[a.POSITION_GAIN])) * math.exp(-since / lag)


def _moved(start: Array, ahead: Any, p: Array) -> None:
    """Into one start: the mass is so far ahead of its reading [m]."""
    start[[s.X, s.MASS]] += ahead
    start[s.PHI] += ahead / p[a.D]


def _show_late(t: Array, y: Array, ahead: float, p: Array) -> None:
    """Into readings (n, 3) that begin where the mass is: the sensor begins so far behind it [m]."""
    if ahead != 0.0:
        y[:, 2] -= p[a.POSITION_GAIN] * ahead * np.exp((t[0] - t) / p[a.POSITION_LAG])


def simulate_each(experiment: Experiment, models: Sequence[Model], nuisances: Sequence[Array]) -> Array:
    """As `simulate` for k models with a nuisance (M, 2) each: readings (k, N, 3), side by side where their steps agree."""
    y = np.empty((len(models), experiment.t.size, 3))
    alike: dict[Any, list[int]] = {}
    for k, model in enumerate(models):
        alike.setdefault((_delays(model.vector), s.paced(model.vector)), []).append(k)
    batches = [same[at : at + s.LANES] for same in alike.values() for at in range(0, len(same), s.LANES)]

    def fill(batch: list[int]) -> None:
        ready = commands(experiment, models[batch[0]].vector)
        if len(batch) >= _WORTH_LANES:
            _side_by_side(
                experiment, [models[k] for k in batch], [nuisances[k] for k in batch], ready, y, batch
            )
            return
        for k in batch:
            y[k] = run(experiment, models[k], nuisances[k], ready)[1]

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(fill, batches))
    return y


def _side_by_side(
    experiment: Experiment, models: Sequence[Model], nuisances: Sequence[Array], ready: tuple[Array, Array], y: Array,
    at: Sequence[int],
) -> None:  # fmt: skip
    """Readings of at most LANES models into y[at]; lanes without one repeat the last."""
    vectors = [model.vector for model in models]
    each = [_starts(experiment, p, nuisance) for p, nuisance in zip(vectors, nuisances, strict=True)]
    lane = [min(k, len(vectors) - 1) for k in range(s.LANES)]
    starts, p = np.stack([each[k] for k in lane], axis=-1), np.stack([vectors[k] for k in lane], axis=-1)
    last = np.empty(0)
    for m in range(experiment.moves):
        rows = experiment.rows(m)
        ahead = np.zeros(len(vectors))
        if m:
            _carry_play(experiment, m, p, starts, last)
            shown = [y[k, rows.start - 1, 2] for k in at]
            ends = zip(vectors, last[s.MASS], shown, strict=False)
            ahead = np.array([_ahead(experiment, m, *end) for end in ends])
            _moved(starts[m], ahead[lane], p)
        states = np.zeros((rows.stop - rows.start, s.COLUMNS, s.LANES))
        s.run_lanes(
            experiment.t[rows], ready[0][rows], ready[1][rows], experiment.fine[rows], experiment.theta[rows], p, vectors[0],
            starts[m], states, experiment.steps,
        )  # fmt: skip
        last = states[-1]
        apart = np.ascontiguousarray(np.moveaxis(states, 2, 0)[: len(vectors)])
        for k, own, model, vector, behind in zip(at, apart, models, vectors, ahead, strict=True):
            show(experiment.t[rows], own, ready[1][rows], vector, y[k, rows])
            _show_late(experiment.t[rows], y[k, rows], float(behind), vector)
            if experiment.driven.size:
                as_followed(experiment.t[rows], own, model, experiment.shown[rows], y[k, rows])


def _starts(experiment: Experiment, p: Array, nuisance: Array) -> Array:
    """(M, 8) states at the start of every move, at rest."""
    starts = np.zeros((experiment.moves, len(s.STATES)))
    i = experiment.rest[:, 0] + nuisance[:, 0]
    x = experiment.rest[:, 1] + nuisance[:, 1]
    # The rest current is what the sensor shows; the plant has the current behind offset and gain.
    extended = p[a.EXTENDED] != 0.0
    true_i = (i - p[a.CURRENT_OFFSET]) / p[a.CURRENT_GAIN] if extended else i
    true_x = _behind_sensor(x, p) if extended else x
    before = np.where(experiment.before != 0.0, experiment.before, np.sign(experiment.peak))
    starts[:, s.LAGGED], starts[:, s.I], _ = experiment.at_rest(true_i, p)
    starts[:, s.MASS] = true_x
    starts[:, s.X] = true_x + (0.5 * p[a.BACKLASH] * before if extended else 0.0)
    # On which side of the play a log begins is unknown: what is free there is the screw, not the mass.
    first = experiment.before == 0.0
    starts[first, s.MASS] -= nuisance[first, 1]
    starts[:, s.PHI] = starts[:, s.X] / p[a.D]
    starts[:, s.H], starts[:, s.SAG] = _slow_start(experiment, p)
    return starts


def _behind_sensor(reading: Array, p: Array) -> Array:
    """Position whose reading at rest is `reading` [m], by fixed point: periodic errors are small and smooth."""
    x = reading.copy()
    for _ in range(_FIXED_POINT_STEPS):
        turn = 2.0 * math.pi * x / p[a.POSITION_PERIOD]
        error = p[a.POSITION_SIN] * np.sin(turn) + p[a.POSITION_COS] * (np.cos(turn) - 1.0)
        x = (reading - error) / p[a.POSITION_GAIN]
    return x
