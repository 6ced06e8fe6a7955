"""Synthetic logs with known answers: moves of the simulated actuator, a fault at any time, effects, spread
and noise.

The same scenario, rig and seed give the same log. The fault begins at its own time, which need not be a
sample.
"""

import gzip
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.physics import simulation as sim
from observer_fi.physics.drives import DRIVES, Drive, position_loop
from observer_fi.physics.equations import D
from observer_fi.physics.fault_row import NOMINAL, FaultRow
from observer_fi.physics.faults import FAULT_KINDS, broken
from observer_fi.physics.rigs import Model, Rig, commanded, override, unknown_name, with_values
from observer_fi.physics.trapezoid import quarters
from observer_fi.records import CHANNELS, Array, Log

MOST_SAMPLES = 1e8
_LEAST = 0.2  # of a value: a spread never turns a sign


class Move(NamedTuple):
    """One commanded move: when it starts [s], its speed [rad/s, signed], and for how long it is commanded [s]."""

    start_s: float
    speed: float
    seconds: float


@dataclass(frozen=True)
class Fault:
    """What goes wrong (a kind of `FAULT_KINDS`) and when [s]. channel of a sensor fault; size in SI units, None for the usual."""

    kind: str = "none"
    at_s: float = 0.0
    channel: str | None = None
    size: float | None = None

    @property
    def label(self) -> str:
        """Label of the right verdict."""
        return self.row.label

    @property
    def row(self) -> FaultRow:
        """The right verdict."""
        return FAULT_KINDS[self.kind]

    @property
    def changes_plant(self) -> bool:
        """Whether the actuator is another from then on; a failed sensor only shows another."""
        return bool(self.row.made_by[self.kind].parameters)


@dataclass(frozen=True)
class Scenario:
    """One log. effects: values of parameters of the equations, all the time; noise: times that of the rig."""

    moves: tuple[Move, ...] = (Move(0.3, 410.0, 2.5),)
    seconds: float = 3.2
    rate_hz: float = 1600.0
    pitch_deg: float = 0.0
    fault: Fault = Fault()
    effects: Mapping[str, float] = field(default_factory=dict)
    spread: bool = False
    noise: float = 1.0
    seed: int = 0


@dataclass(frozen=True)
class Truth:
    """What is known about a synthetic log. parameters: those that differ from the rig's."""

    label: str
    channel: str | None
    onset_s: float | None
    scenario: Scenario
    parameters: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file beside the log."""
        return {"schema": "observer-fi/truth/1", **asdict(self)}


def synthesise(scenario: Scenario, rig: Rig, name: str = "synthetic") -> tuple[Log, Truth]:
    """The log of a scenario, and its truth. Raises UsageError for a fault, channel or effect that does not exist."""
    _check(scenario)
    if not rig.driven.servo:
        servos = " or ".join(f'"{row.name}"' for row in DRIVES.values() if row.servo)
        raise UsageError(
            f'rig {rig.name!r} has drive = "{rig.drive}": a synthetic log needs a servo (drive = {servos})'
        )
    rng = np.random.default_rng(scenario.seed)
    drawn = _drawn(rig, rng) if scenario.spread else {}
    plant = override(rig.model, NOMINAL, **{**drawn, **scenario.effects})
    t = np.arange(round(scenario.seconds * scenario.rate_hz)) / scenario.rate_hz
    knots, values = trapezoids(scenario.moves, plant["accel_cmd"] or np.inf, float(t[-1]))
    clean, states = _run(t, knots, values, scenario, plant, rig.driven)
    z = clean + scenario.noise * rig.file_noise_std * rng.standard_normal(clean.shape)
    _break_sensor(t, z, scenario.fault, rng)
    w_cmd, pitch = np.interp(t, knots, values), np.full(t.size, scenario.pitch_deg)
    log = Log(name, t, z, w_cmd, pitch, metadata=(f"synthetic, seed {scenario.seed}",))
    if rig.driven.command:
        goal = plant["D"] * _travelled(t, knots, values)
        log = commanded(
            replace(log, encoder=states[:, sim.PHI].copy(), position_cmd=goal), with_values(rig, drawn)
        )
    fault = scenario.fault
    faulty = fault.label != NOMINAL
    changed = {k: plant[k] for k in (*drawn, *scenario.effects)}
    return log, Truth(fault.label, fault.channel, fault.at_s if faulty else None, scenario, changed)


def _check(scenario: Scenario) -> None:
    fault = scenario.fault
    if fault.kind not in FAULT_KINDS:
        raise unknown_name(fault.kind, tuple(FAULT_KINDS), "fault")
    if fault.row.by_channel != (fault.channel is not None):
        raise UsageError(
            f"fault {fault.kind}: a channel is for sensor faults, and they need one ({', '.join(CHANNELS)})"
        )
    if fault.channel is not None and fault.channel not in CHANNELS:
        raise unknown_name(fault.channel, CHANNELS, "channel")
    if not 2.0 <= scenario.seconds * scenario.rate_hz <= MOST_SAMPLES or not scenario.rate_hz > 0.0:
        raise UsageError(
            f"a log of {scenario.seconds} s at {scenario.rate_hz} samples/s: 2 to {MOST_SAMPLES:.0e} "
            f"samples, please"
        )
    if fault.label != NOMINAL and not 0.0 <= fault.at_s <= scenario.seconds:
        raise UsageError(f"the fault at {fault.at_s} s is outside the log of {scenario.seconds} s")
    values = (scenario.pitch_deg, fault.size or 0.0, *(number for move in scenario.moves for number in move))
    if not np.isfinite(values).all() or not 0.0 <= scenario.noise < np.inf:
        raise UsageError(
            "moves, pitch, noise and the size of a fault must be finite numbers, noise not negative"
        )


def _drawn(rig: Rig, rng: np.random.Generator) -> dict[str, float]:
    """One rig from the population: every parameter that has a spread, drawn from it."""
    factors = {
        name: max(_LEAST, 1.0 + q.spread * rng.standard_normal())
        for name, q in rig.quantities.items()
        if q.spread
    }
    return {name: rig.quantities[name].value * factor for name, factor in factors.items()}


def trapezoids(moves: tuple[Move, ...], accel: float, end: float) -> tuple[Array, Array]:
    """Knots (times, speeds) of the commanded trapezoids. Moves that touch go from speed to speed without a
    stop.

    Raises UsageError for moves that overlap or are too short to reach their speed.
    """
    t, w = [0.0], [0.0]
    for k, move in enumerate(moves):
        if move.seconds <= 0.0 or move.start_s < t[-1] - 1e-9:
            raise UsageError(f"move {k + 1} starts at {move.start_s} s, before the one ahead of it has ended")
        t += [move.start_s, move.start_s + abs(move.speed - w[-1]) / accel]
        w += [w[-1], move.speed]
        stop = move.start_s + move.seconds
        if t[-1] > stop:
            raise UsageError(f"move {k + 1}: {move.seconds} s are too short to reach {move.speed} rad/s")
        t.append(stop)
        w.append(move.speed)
        if k + 1 == len(moves) or moves[k + 1].start_s > stop + abs(move.speed) / accel:
            t.append(stop + abs(move.speed) / accel)
            w.append(0.0)
    t.append(max(end, t[-1]) + 1.0)
    w.append(w[-1])
    return np.array(t), np.array(w)


def _run(
    t: Array, knots: Array, values: Array, scenario: Scenario, plant: Model, drive: Drive
) -> tuple[Array, Array]:
    """(n, 3) readings without noise and (n, COLUMNS) states: the plant until the fault, the changed one from its state on."""
    fault = scenario.fault
    start = np.zeros(len(sim.STATES))
    if not fault.changes_plant:
        return _readings(t, knots, values, scenario.pitch_deg, plant, start, drive)
    before, after = t[t < fault.at_s], t[t >= fault.at_s]
    until = np.append(before, fault.at_s)
    first, states = _readings(until, knots, values, scenario.pitch_deg, plant, start, drive)
    state = states[-1, : len(sim.STATES)]
    commanded = np.append(values[knots > fault.at_s], 0.0)
    ahead = float(commanded[np.flatnonzero(commanded)[0]]) if commanded.any() else 1.0
    forwards = (float(state[sim.W]) or ahead) > 0.0  # as it moves, or will be told to
    changed = broken(plant, fault.kind, float(state[sim.X]), forwards, fault.size)
    on = np.union1d([fault.at_s], after)  # the fault may fall on a sample
    second, later = _readings(on, knots, values, scenario.pitch_deg, changed, state, drive)
    own = slice(on.size - after.size, None)
    return np.vstack((first[:-1], second[own])), np.vstack((states[:-1], later[own]))


def _readings(
    t: Array, knots: Array, values: Array, pitch: float, model: Model, start: Array, drive: Drive
) -> tuple[Array, Array]:
    p = model.vector
    states, y = np.empty((t.size, sim.COLUMNS)), np.empty((t.size, 3))
    theta = np.full(t.size, pitch)
    if drive.command:
        _follow_position(t, knots, values, theta, p, start, states)
        sim.readings(t, states, p, y)
        return y, states
    delay, late = model["input_delay"] + model["tick_phase"], model["servo_delay"]
    slew = model["accel_limit"], model["accel_ahead"]
    now = quarters(t, knots, values, delay, *slew)
    behind = quarters(t, knots, values, delay + late, *slew) if late else now
    sim.run(t, now, behind, np.ones(t.size, dtype=np.bool_), theta, p, start, states)
    sim.readings(t, states, p, y)
    return y, states


def _travelled(t: Array, knots: Array, values: Array) -> Array:
    """Integral of the piecewise linear speed through the knots, from the first on [rad], at the times t of any shape."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(knots)
    at = np.clip(np.searchsorted(knots, t, "right") - 1, 0, knots.size - 2)
    until = np.concatenate(([0.0], np.cumsum(steps)))[at]
    return until + 0.5 * (values[at] + np.interp(t, knots, values)) * (t - knots[at])


_QUARTERS = np.arange(5) / 4.0


def _follow_position(
    t: Array, knots: Array, values: Array, theta: Array, p: Array, start: Array, states: Array
) -> None:
    """States of a plant whose speed command follows its own motor angle: equations 1 to 13 interval by interval.

    Within an interval the angle of the loop goes on at the speed of its first sample: off by half the square of the
    interval times the acceleration, 4e-3 rad in the steepest start at 1600 samples/s.
    """
    state, pair = start.copy(), np.empty((2, sim.COLUMNS))
    fine, commands = np.ones(2, dtype=np.bool_), np.empty((2, 4))
    since = np.diff(t)[:, None] * _QUARTERS
    goal = p[D] * _travelled(t[:-1, None] + since, knots, values)
    for k in range(t.size - 1):
        now = position_loop(goal[k], state[sim.PHI] + state[sim.W] * since[k], p)
        commands[0], commands[1] = now[:4], now[4]
        sim.run(t[k : k + 2], commands, commands, fine, theta[k : k + 2], p, state, pair)
        states[k], state = pair[0], pair[1, : len(sim.STATES)].copy()
    states[-1] = pair[1]


def _break_sensor(t: Array, z: Array, fault: Fault, rng: np.random.Generator) -> None:
    """The sensor fault, in place."""
    if fault.channel is None:
        return
    c = CHANNELS.index(fault.channel)
    bad = t >= fault.at_s
    sizes = fault.row.made_by[fault.kind].sizes
    size = fault.size if fault.size is not None else (sizes[c] if sizes else 0.0)
    if fault.kind == "sensor_frozen":
        z[bad, c] = z[np.flatnonzero(~bad)[-1], c] if not bad.all() else z[0, c]
    elif fault.kind == "sensor_offset":
        z[bad, c] += size
    elif fault.kind == "sensor_drift":
        z[bad, c] += size * (t[bad] - fault.at_s)
    elif fault.kind == "sensor_gain":
        z[bad, c] *= 1.0 + size
    elif fault.kind == "sensor_noise":
        z[bad, c] += size * rng.standard_normal(int(bad.sum()))
    else:
        z[bad, c] = np.nan


def drawn_scenario(rng: np.random.Generator, label: str, transient: bool, seed: int) -> Scenario:
    """One move of the Monte Carlo: 205 to 410 rad/s, either way, -12 to 12 deg; the fault in the start or after it."""
    speed = float(rng.uniform(205.0, 410.0) * rng.choice((-1.0, 1.0)))
    seconds = float(rng.uniform(1.5, 2.5))
    start = float(rng.uniform(0.2, 0.4))
    after = rng.uniform(0.004, 0.24) if transient else rng.uniform(0.35, seconds - 0.6)
    fault = Fault() if label == NOMINAL else Fault(label, start + float(after))
    pitch = float(rng.uniform(-12.0, 12.0))
    return Scenario(
        (Move(start, speed, seconds),), start + seconds + 0.4, 1600.0, pitch, fault, {}, True, 1.0, seed
    )


def csv_bytes(log: Log, compress: bool = False) -> bytes:
    """The log as CSV of the contract, its metadata in front; gzip without a date, so that the bytes repeat."""
    extra = {"speed_cmd_rad_s": log.w_cmd}
    if log.position_cmd is not None and log.encoder is not None:
        extra = {"position_cmd_m": log.position_cmd, "encoder_rad": log.encoder}
    if log.load is not None:
        extra["load_n"] = log.load
    out = io.StringIO()
    for line in log.metadata:
        out.write(f"# {line}\n")
    out.write(",".join(("time_s,voltage_v,current_a,position_m,pitch_deg", *extra)) + "\n")
    digits = "%.6g" if log.position_cmd is None else "%.10g"
    table = np.column_stack((log.t, log.z, log.pitch, *extra.values()))
    for t, voltage, current, position, pitch, *others in table.tolist():
        command = ",".join(digits % value for value in others)
        out.write(f"{t:.6f},{voltage:.4f},{current:.6f},{position:.7f},{pitch:.3f},{command}\n")
    data = out.getvalue().replace("nan", "").encode()
    return gzip.compress(data, mtime=0) if compress else data
