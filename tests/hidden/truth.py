"""An independent truth: a log of the mass-shifter with a known fault and known effects.

Shares no code with the package under test: own integrator, own stick-slip, own sampled servo, own noise.
"""

import gzip
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from .acquisition import Acquisition, Scene, record_through, true_sizes
from .effects import ALL, Effect, fields_of
from .faults import DEFAULT_SIZES, NO_FAULT, Fault, faulty_plant
from .plant import Motion, Plant, Servo, run
from .profiles import Profile, campaign, command_at, pitch_at, travel_at
from .rig import SCREW_RAD_PER_MOTOR_RAD, TABLE_1, Rig
from .sensors import ENCODER_EDGES_PER_TURN, Logger, Sensors, needs_history, record


@dataclass(frozen=True)
class TruthSpec:
    """All that decides a log but its noise.

    then: a fault of the plant that comes later, on top. start_m: mass position at t = 0; start_integral_rad: the
    servo's error integral I then, which holds it. static_ratio: break-away friction over sliding friction. servo_hz:
    rate of the PI servo; servo_encoder: it sees quadrature steps instead of the exact speed. substep_hz: integration
    steps a second, a multiple of 2 * servo_hz and of the log's rate. Kx: gain of a position loop around the servo [1/s], 0 for
    none, and window_m: how near to its goal it rests; the log then has position_cmd_m and no commanded speed. speed_forward,
    torque_forward: shares of the commanded speed and of the torque for its acceleration that this loop is fed forward.
    """

    profile: Profile = campaign()
    rig: Rig = TABLE_1
    fault: Fault = NO_FAULT
    then: Fault = NO_FAULT
    effects: tuple[Effect, ...] = ()
    logger: Logger = Logger()
    start_m: float = 0.0
    start_integral_rad: float = 0.0
    static_ratio: float = 1.0
    servo_hz: float = 8000.0
    servo_encoder: bool = False
    substep_hz: float = 48000.0
    Kx: float = 0.0
    window_m: float = 0.0
    speed_forward: float = 0.0
    torque_forward: float = 0.0


def make_log(spec: TruthSpec, seed: int) -> tuple[pd.DataFrame, dict]:
    """The log (columns of the contract) and its truth (plain data for JSON). The seed draws noise only."""
    times = sample_times(spec)
    sensors = Sensors(**fields_of(spec.effects, "sensors"))
    motion, stops = _simulate(spec, dense=needs_history(sensors))
    frame = record(
        motion,
        times,
        pitch_at(spec.profile, times),
        command_at(spec.profile, spec.rig.accel, times),
        spec.rig.Rs,
        sensors,
        spec.logger,
        spec.fault,
        np.random.default_rng(seed),
    )
    if spec.Kx > 0.0:
        goal = spec.rig.D * travel_at(spec.profile, spec.rig.accel, times)
        frame = frame.drop(columns="speed_cmd_rad_s").assign(position_cmd_m=np.round(goal, 10))
    return frame, _truth(spec, seed, stops)


def make_log_through(acquisition: Acquisition, spec: TruthSpec, seed: int) -> tuple[pd.DataFrame, dict]:
    """As `make_log`, recorded by a logger as it is, whose noise and rate count; the truth has `true_sizes` as "acquisition"."""
    if spec.Kx > 0.0:
        raise ValueError("a position servo's command is not recorded through a logger as it is")
    spec = replace(spec, logger=replace(spec.logger, rate_hz=acquisition.clock.rate_hz))
    motion, stops = _simulate(spec, dense=True)
    scene = Scene(
        motion,
        partial(pitch_at, spec.profile),
        partial(command_at, spec.profile, spec.rig.accel),
        spec.rig.Rs,
        Sensors(**fields_of(spec.effects, "sensors")),
        spec.logger,
        spec.fault,
    )
    frame, spikes = record_through(scene, acquisition, sample_times(spec), seed)
    return frame, {**_truth(spec, seed, stops), "acquisition": true_sizes(acquisition, spikes)}


def true_motion(spec: TruthSpec) -> Motion:
    """What the rig did at the sample instants, before any sensor."""
    return _simulate(spec, dense=False)[0]


def without_noise(spec: TruthSpec) -> TruthSpec:
    return replace(spec, logger=spec.logger.noiseless())


def sample_times(spec: TruthSpec):
    """Sample instants [s]: from 0, up to but without the profile's end."""
    return np.arange(int(round(spec.profile.duration_s * spec.logger.rate_hz))) / spec.logger.rate_hz


def write_log(frame: pd.DataFrame, path: str | Path) -> Path:
    """Writes .csv, .csv.gz or .parquet; equal frames give equal bytes."""
    path = Path(path)
    if path.name.endswith(".parquet"):
        frame.to_parquet(path, index=False)
    elif path.name.endswith(".csv.gz"):
        path.write_bytes(gzip.compress(frame.to_csv(index=False).encode(), 6, mtime=0))
    elif path.name.endswith(".csv"):
        path.write_text(frame.to_csv(index=False))
    else:
        raise ValueError(f"{path.name}: a log is .csv, .csv.gz or .parquet")
    return path


def _simulate(spec: TruthSpec, dense: bool) -> tuple[Motion, tuple[float, float]]:
    """Motion at the sample instants, or at every step if dense, and where the stops are at the end [m]."""
    step = 1.0 / spec.substep_hz
    per_tick = _whole(spec.substep_hz, spec.servo_hz)
    per_sample = _whole(spec.substep_hz, spec.logger.rate_hz)
    if per_tick % 2:
        raise ValueError(f"substep_hz {spec.substep_hz} must be an even multiple of servo_hz {spec.servo_hz}")
    steps = (sample_times(spec).size - 1) * per_sample + 1
    plants, switches = _phases(spec)
    rows, low, high = run(
        plants,
        switches,
        _servo(spec),
        _servo_command(spec, steps // per_tick + 1),
        _fed_forward(spec, steps // per_tick + 1),
        pitch_at(spec.profile, np.arange(steps) * step),
        step,
        per_tick,
        1 if dense else per_sample,
        (spec.start_m, spec.start_integral_rad),
    )
    return Motion(*rows.T.copy()), (low, high)


def _phases(spec: TruthSpec) -> tuple[tuple[Plant, ...], np.ndarray]:
    """The plants that follow one another, as many in every log (numba compiles once), and the step from which each counts."""
    never = np.iinfo(np.int64).max
    plant = _plant(spec)
    plants, switches = [plant], [0]
    for fault in (spec.fault, spec.then):
        begin = end = never
        after = plants[-1]
        if fault.onset_s is not None:
            begin = int(round(fault.onset_s * spec.substep_hz))
            after = faulty_plant(after, spec.rig, fault, _direction_at(spec, fault.onset_s))
        if fault.onset_s is not None and np.isfinite(fault.duration_s) and fault.label != "sensor_fault":
            end = int(round((fault.onset_s + fault.duration_s) * spec.substep_hz))
        healed = plants[-1] if end < never else after
        plants += [after, healed]
        switches += [begin, end]
    order = np.argsort(switches, kind="stable")
    return tuple(plants[k] for k in order), np.array(switches, dtype=np.int64)[order]


def _plant(spec: TruthSpec) -> Plant:
    rig = spec.rig
    letters = {
        name: float(getattr(rig, name))
        for name in ("Rm", "Rs", "Km", "D", "Vmax", "J", "A", "B", "C", "E", "L")
    }
    return Plant(
        **letters,
        stop_low=rig.stop_low_m,
        stop_high=rig.stop_high_m,
        static_ratio=spec.static_ratio,
        screw_ratio=SCREW_RAD_PER_MOTOR_RAD,
    )._replace(**fields_of(spec.effects, "plant"))


def _servo(spec: TruthSpec) -> Servo:
    edge = 2 * np.pi / ENCODER_EDGES_PER_TURN if spec.servo_encoder else 0.0
    loop = (spec.Kx, spec.window_m / spec.rig.D, 2 * np.pi / spec.logger.encoder_edges)
    servo = Servo(spec.rig.Kp, spec.rig.Ki, encoder_step=edge, Kx=loop[0], window=loop[1], loop_step=loop[2])
    return servo._replace(**fields_of(spec.effects, "servo"))


def _servo_command(spec: TruthSpec, ticks: int):
    """Command that the servo [rad/s], or the loop around it [rad], follows at each tick, late and slew-limited by effects."""
    fields = fields_of(spec.effects, "command")
    accel = min(spec.rig.accel, fields.get("slew", np.inf))
    times = (np.arange(ticks) + 0.5) / spec.servo_hz - fields.get("delay", 0.0)
    return (travel_at if spec.Kx > 0.0 else command_at)(spec.profile, accel, times)


def _fed_forward(spec: TruthSpec, ticks: int):
    """Speed [rad/s] and current [A] beside the position loop at each tick, (ticks, 2)."""
    edges = np.arange(ticks + 1) / spec.servo_hz
    speeds = command_at(spec.profile, spec.rig.accel, edges)
    pull = spec.rig.J / spec.rig.Km * spec.servo_hz * np.diff(speeds)
    middle = 0.5 * (speeds[1:] + speeds[:-1])
    return np.column_stack([spec.speed_forward * middle, spec.torque_forward * pull])


def _direction_at(spec: TruthSpec, time_s: float) -> float:
    """Sign of the move in progress at `time_s`, or of the latest one before it."""
    begun = [move for move in spec.profile.moves if move.start_s <= time_s]
    return float(np.sign((begun or spec.profile.moves[:1])[-1].speed))


def _truth(spec: TruthSpec, seed: int, stops: tuple[float, float]) -> dict:
    fault = spec.fault
    hit = fault.label == "overload"
    return {
        "label": fault.label,
        "channel": fault.channel,
        "onset_s": fault.onset_s,
        "kind": fault.kind or None,
        "size": fault.magnitude if fault.kind or fault.label in DEFAULT_SIZES else None,
        "end_s": fault.onset_s + fault.duration_s if np.isfinite(fault.duration_s) else None,
        "growth_s": fault.growth_s,
        "then": {"label": spec.then.label, "onset_s": spec.then.onset_s},
        "contact_m": stops[0 if _direction_at(spec, fault.onset_s) < 0 else 1] if hit else None,
        "stops_m": list(stops),
        "effects": [_effect_truth(item) for item in spec.effects],
        "rig": asdict(spec.rig),
        "moves": [asdict(move) for move in spec.profile.moves],
        "logger": asdict(spec.logger),
        "seed": seed,
    }


def _effect_truth(item: Effect) -> dict:
    cause = ALL[item.cause]
    units = {parameter.name: parameter.unit for parameter in cause.parameters}
    return {
        "cause": item.cause,
        "equation": cause.equation,
        "equations": sorted(cause.equations),
        "regressors": sorted(cause.regressors),
        "formula": cause.formula,
        "parameters": {name: {"value": value, "unit": units[name]} for name, value in item.values},
    }


def _whole(rate: float, divisor: float) -> int:
    ratio = rate / divisor
    if abs(ratio - round(ratio)) > 1e-9 * ratio:
        raise ValueError(f"{rate} Hz is no whole multiple of {divisor} Hz")
    return int(round(ratio))
