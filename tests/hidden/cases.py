"""Draws for Monte Carlo: moves with a fault, campaigns with a hidden effect. A seed repeats a case."""

from dataclasses import replace

import numpy as np

from .effects import ALL, sized_effect
from .faults import CHANNELS, FAILURES, NO_FAULT, SENSOR_SIZES, UNKNOWN_SIZES, Fault
from .profiles import (
    Move,
    Profile,
    campaign,
    contact_campaign,
    rich_campaign,
    shaped_move,
    single_move,
)  # fmt: skip
from .rig import TABLE_1, draw_rest_integral, draw_rig
from .sensors import Logger
from .truth import TruthSpec

TRANSIENT_S = 0.25  # the start transient of section 3 of the paper
LEFT_TO_MOVE_S = 1.0  # a fault needs some of the move to show itself
TRANSIENT_SHARE = 0.3


def draw_move_case(seed: int, label: str) -> TruthSpec:
    """One move with a fault of class `label`: 205 to 410 rad/s either way, pitch -12 to 12 deg, 3.3 to 5.8 s.

    Pitch sways by up to 0.4 deg. Three faults in ten begin within 250 ms of the start, the others later.
    """
    rng = np.random.default_rng([seed, 1])
    rig = draw_rig(rng)
    pitch = rng.uniform(-12.0, 12.0)
    profile = single_move(
        speed=rng.choice([-1.0, 1.0]) * rng.uniform(205.0, 410.0),
        hold_s=rng.uniform(2.5, 5.0),
        pitch_deg=pitch,
        pitch_wave_deg=rng.uniform(0.0, 0.4),
        pitch_wave_phase=rng.uniform(0.0, 2 * np.pi),
    )
    fault = _draw_fault(rng, label, profile)
    return TruthSpec(profile, rig, fault, start_integral_rad=draw_rest_integral(rng, rig, pitch))


# Sizes of a failing sensor in sigmas of its noise: of a drift in a second, of a gain at the reading of a steady move.
FAILING_SIGMAS = {
    "bias": 10.0, "drift": 10.0, "gain": 10.0, "noise_burst": 5.0, "saturation": 10.0, "stuck_bit": 10.0,
}  # fmt: skip
STEADY = {"voltage": 6.0, "current": 22e-3, "position": 1e-3}  # V, A, m: reading in the middle of a move


def draw_failing_case(seed: int, kind: str, channel: str, factor: float = 1.0) -> TruthSpec:
    """One move in which a sensor fails as `kind` of `FAILURES` in mid-move, by `factor` times `FAILING_SIGMAS`."""
    if kind not in FAILURES:
        raise ValueError(f"no failure {kind!r}: there are {', '.join(FAILURES)}")
    spec = draw_move_case(seed, "nominal")
    move = spec.profile.moves[0]
    rng = np.random.default_rng([seed, 13])
    onset = move.start_s + rng.uniform(TRANSIENT_S + 0.05, move.hold_s - LEFT_TO_MOVE_S)
    sign = rng.choice((-1.0, 1.0)) if kind in ("bias", "drift") else 1.0
    size = sign * _failing_size(kind, channel, factor * FAILING_SIGMAS.get(kind, 0.0))
    return replace(spec, fault=Fault("sensor_fault", onset, kind, channel, float(size)))


def _failing_size(kind: str, channel: str, sigmas: float) -> float:
    """The size of a fault that is worth so many sigmas, as in `FAILURES`."""
    logger = Logger()
    noise = {
        "voltage": logger.voltage_noise_v,
        "current": logger.current_noise_a,
        "position": logger.position_noise_m,
    }
    if kind == "noise_burst":
        return sigmas
    if kind == "gain":
        return 1.0 + sigmas * noise[channel] / STEADY[channel]
    return sigmas * noise[channel]


def draw_effect_case(seed: int, cause: str | None, size_factor: float) -> TruthSpec:
    """A campaign that hides `cause` at `size_factor` times its small size, or a control (cause None).

    Rig with the paper's spread and 2 % on J, Kp, Ki, Rs, Vmax; drawn sign and phase of the effect. Contact
    effects get the campaign that leans on both stops, a nonlinear gravity by itself the one at many pitches, the others
    eighteen moves at three pitches and speeds.
    """
    return draw_effects_case(seed, () if cause is None else (cause,), size_factor)


def draw_effects_case(seed: int, causes: tuple[str, ...], size_factor: float) -> TruthSpec:
    """As draw_effect_case, with several effects at once."""
    rng = np.random.default_rng([seed, 2])
    rig = draw_rig(rng, identification_percent=2.0)
    start_integral = draw_rest_integral(rng, rig, 0.0)
    profile = rich_campaign()
    if causes == ("gravity_nonlinearity",):
        profile = campaign()  # three pitches cannot tell it from another B
    if any("contact" in ALL[cause].equations for cause in causes):
        profile = contact_campaign()
        low, high = rng.uniform(-7e-4, -4e-4), rng.uniform(4e-4, 7e-4)
        rig = replace(rig, stop_low_m=low, stop_high_m=high)
    effects = tuple(sized_effect(cause, size_factor, rng) for cause in causes)
    return TruthSpec(profile, rig, effects=effects, start_integral_rad=start_integral)


def _draw_fault(rng: np.random.Generator, label: str, profile: Profile) -> Fault:
    move = profile.moves[0]
    early = rng.random() < TRANSIENT_SHARE
    window = (0.0, TRANSIENT_S) if early else (TRANSIENT_S + 0.05, move.hold_s - LEFT_TO_MOVE_S)
    onset = move.start_s + rng.uniform(*window)
    if label == "nominal":
        return NO_FAULT
    if label == "sensor_fault":
        kind, channel = str(rng.choice(list(SENSOR_SIZES))), str(rng.choice(CHANNELS))
        size = SENSOR_SIZES[kind][channel]
        if kind in ("bias", "drift") and rng.random() < 0.5:
            size = -size
        return Fault(label, onset, kind, channel, size)
    if label == "unknown":
        return Fault(label, onset, str(rng.choice(list(UNKNOWN_SIZES))))
    return Fault(label, onset)


SEVERITIES = {
    "stiffness": (8.5, 1700.0),  # N m/m^2, log-uniform: a tenth to twenty times Table 1
    "share": (0.1, 0.95),
    "drag": (0.3, 1.3),  # of what a decoupled motor feels
    "inertia": (0.3, 1.3),
    "slip": (0.05, 0.9),  # log-uniform, of the travel
    "jam": (0.1, 3.0),  # log-uniform, by how many times friction rises
    "duration_s": (0.05, 2.0),  # log-uniform
    "growth_s": (0.5, 3.0),
}
SEVERITY_KINDS = (
    "overload",
    "coupling_loss",
    "slip",
    "jam",
    "coupling_for_a_while",
    "slip_growing",
    "jam_growing",
)

# Where a fault of any size may begin other than in mid-move, and two faults of one move.
PLACES = ("in_a_start", "at_a_reversal", "in_a_rest", "before_the_first_sample")
PAIRS_OF_FAULTS = {"stop_then_loss": ("overload", "coupling_loss"), "slip_then_jam": ("slip", "jam")}
PLACED_KINDS = (*PLACES, *PAIRS_OF_FAULTS)
REST_S, FORTH_AND_BACK = (
    0.4,
    4,
)  # the rest in which a fault begins; moves one after another of a command without rests


def draw_severity_case(seed: int, kind: str, shape: str = "") -> TruthSpec:
    """One move with a fault of any size. kind: of SEVERITY_KINDS, or "nominal".

    Rig and move as in `draw_move_case`; the fault begins while the motor runs, and has at least 0.4 s of the move left.
    shape: of the command, of `SHAPES`; a trapezoid where there is none.
    """
    rng = np.random.default_rng([seed, 7])
    rig = draw_rig(rng)
    rig = replace(
        rig,
        C=_log_uniform(rng, *SEVERITIES["stiffness"]),
        E=rng.uniform(*SEVERITIES["share"]),
        A_loose=TABLE_1.A_loose * rng.uniform(*SEVERITIES["drag"]),
        J_loose=rig.J * rng.uniform(*SEVERITIES["inertia"]),
    )
    pitch = rng.uniform(-12.0, 12.0)
    speed, length = rng.choice([-1.0, 1.0]) * rng.uniform(205.0, 410.0), rng.uniform(2.5, 5.0)
    wave, phase = rng.uniform(0.0, 0.4), rng.uniform(0.0, 2 * np.pi)
    pitched = {"pitch_deg": pitch, "pitch_wave_deg": wave, "pitch_wave_phase": phase}
    plain = single_move(speed=speed, hold_s=length, **pitched)
    onset = plain.moves[0].start_s + rng.uniform(0.3, length - 0.4)
    fault = _sized_fault(rng, kind, onset)
    start = draw_rest_integral(rng, rig, pitch)
    profile = shaped_move(shape, speed, length, rng, **pitched) if shape else plain
    return TruthSpec(profile, rig, fault, start_integral_rad=start)


def draw_placed_case(seed: int, kind: str) -> TruthSpec:
    """As `draw_severity_case`, with a fault that begins elsewhere or two in one move. kind: of PLACED_KINDS.

    In a start: within 250 ms of it. At a reversal: within 20 ms of one. In a rest: between a move and the one back. No stop is
    reached at a reversal or in a rest: the mass leaves it. The second of two faults comes 0.4 s after the first, or later.
    """
    spec, rng = draw_severity_case(seed, "nominal"), np.random.default_rng([seed, 17])
    move = spec.profile.moves[0]
    if kind in PAIRS_OF_FAULTS:
        first = rng.uniform(0.3, move.hold_s - 1.2)
        then = rng.uniform(first + 0.4, move.hold_s - 0.4)
        faults = [
            _sized_fault(rng, label, move.start_s + at)
            for label, at in zip(PAIRS_OF_FAULTS[kind], (first, then), strict=True)
        ]
        return replace(spec, fault=faults[0], then=faults[1])
    leaves = kind in ("at_a_reversal", "in_a_rest")
    label = str(
        rng.choice(
            ["coupling_loss", "slip", "jam"] if leaves else ["overload", "coupling_loss", "slip", "jam"]
        )
    )
    profile, onset = spec.profile, 0.0
    if kind == "in_a_start":
        onset = move.start_s + rng.uniform(0.0, TRANSIENT_S)
    elif kind == "at_a_reversal":
        profile = shaped_move(
            "without_rests", move.speed, move.hold_s, rng, pitch_deg=profile.pitch_steps[0][1]
        )
        turns = move.start_s + move.hold_s * np.arange(1, FORTH_AND_BACK) / FORTH_AND_BACK
        onset = rng.choice(turns) + rng.uniform(-0.02, 0.02)
    elif kind == "in_a_rest":
        back = move.brake_s + REST_S
        profile = replace(
            profile,
            moves=(move, Move(back, -move.speed, move.hold_s)),
            duration_s=back + move.hold_s + 0.5,
        )
        onset = back - rng.uniform(0.05, REST_S - 0.05)
    return replace(spec, profile=profile, fault=_sized_fault(rng, label, onset))


def _sized_fault(rng: np.random.Generator, kind: str, onset: float) -> Fault:
    growth = rng.uniform(*SEVERITIES["growth_s"])
    for_a_while = _log_uniform(rng, *SEVERITIES["duration_s"])
    slip, jam = _log_uniform(rng, *SEVERITIES["slip"]), _log_uniform(rng, *SEVERITIES["jam"])
    return {
        "nominal": NO_FAULT,
        "overload": Fault("overload", onset),
        "coupling_loss": Fault("coupling_loss", onset),
        "slip": Fault("slip", onset, size=slip),
        "jam": Fault("jam", onset, size=jam),
        "coupling_for_a_while": Fault("coupling_loss", onset, duration_s=for_a_while),
        "slip_growing": Fault("slip", onset, size=slip, growth_s=growth),
        "jam_growing": Fault("jam", onset, size=jam, growth_s=growth),
    }[kind]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
