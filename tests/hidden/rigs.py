"""Actuators unlike the paper's: drawn over decades, with what their data sheets print and what their loggers keep.

    actuator = draw_actuator(3, "voltage")
    sheet = data_sheet(actuator)                       # options of a command line, 5 % off, friction within a factor of two
    frame, truth = actuator_log(actuator, healthy_spec(actuator), 3)
    frame, truth = actuator_log(actuator, fault_spec(actuator, "jam", 3), 3)

The plant, the servo and the faults are those of plant.py and faults.py; only the numbers are other ones.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from .faults import NO_FAULT, Fault
from .profiles import there_and_back
from .rig import Rig
from .sensors import Logger
from .truth import TruthSpec, make_log

DRIVEN_BY = ("voltage", "current", "pi_servo", "position_servo")
FAULTS_DRAWN = ("nominal", "overload", "coupling_loss", "slip", "jam", "sensor_fault")
SUPPLIES_V = (6.0, 12.0, 18.0, 24.0, 36.0, 48.0)
RATES_HZ = (100.0, 250.0, 500.0, 1000.0, 2000.0, 4800.0)
SUBSTEP_HZ, SERVO_HZ = 48000.0, 8000.0
GRAVITY = 9.80665
KEPT = {
    "voltage": ("time_s", "voltage_v", "current_a", "position_m"),
    "current": ("time_s", "current_a", "position_m"),
    "pi_servo": ("time_s", "voltage_v", "current_a", "position_m", "speed_cmd_rad_s"),
    "position_servo": ("time_s", "voltage_v", "current_a", "position_m", "position_cmd_m", "encoder_rad"),
}


@dataclass(frozen=True)
class Actuator:
    """One actuator. rig: its truth; drive: how its user drives and logs it; power_w: of its motor, nominal; rotor [kg m^2];
    gear, lead [m], mass [kg], travel [m]; speed: of its usual moves [rad/s]; nominal_current [A]; steps: of its logger, V, A,
    m; loop: Kx of a position servo [1/s].
    """

    seed: int
    drive: str
    rig: Rig
    power_w: float
    rotor: float
    gear: float
    lead: float
    mass: float
    travel: float
    speed: float
    nominal_current: float
    logger: Logger
    steps: tuple[float, float, float]
    loop: float

    @property
    def size(self) -> str:
        """Of its motor."""
        return (
            "below 10 W" if self.power_w < 10.0 else "10 to 100 W" if self.power_w < 100.0 else "above 100 W"
        )


def draw_actuator(seed: int, drive: str) -> Actuator:
    """1 W to 1 kW, gears of 1 to 100, leads of 1 to 20 mm, travels of 5 mm to 1 m, servos of 3 to 40 Hz, friction of 5 to
    60 % of the nominal torque, 100 to 5000 samples a second. A draw whose travel takes less than 0.6 s or more than a minute
    is drawn again.
    """
    rng = np.random.default_rng([seed, 14, DRIVEN_BY.index(drive)])
    while True:
        gear = float(np.round(_log(rng, 1.0, 100.0))) if rng.random() < 0.7 else 1.0
        lead, travel = float(rng.choice((1.0, 2.0, 4.0, 5.0, 10.0, 20.0))) * 1e-3, _log(rng, 5e-3, 1.0)
        top = rng.uniform(250.0, 900.0)
        D = lead / (2.0 * np.pi * gear)
        if 0.6 < travel / (top * D) < 60.0:
            break
    power = _log(rng, 1.0, 1000.0)
    supply = float(rng.choice([v for v in SUPPLIES_V if 0.2 * v**2 < 60.0 * power and v**2 > 0.01 * power]))
    Km = supply / top
    Rm = supply**2 / (4.0 * power * rng.uniform(3.0, 8.0))
    rotor = _log(rng, 5e-3, 25e-3) * Km**2 / Rm
    mass = float(np.clip(rng.uniform(0.02, 1.0) * rotor / D**2, 0.02, 300.0))
    turning = rotor * (1.0 + rng.uniform(0.0, 0.3))
    J = turning + mass * D**2
    nominal = supply / Rm / rng.uniform(3.0, 8.0)
    A = rng.uniform(0.05, 0.6) * Km * nominal
    rig = Rig(
        Rm=Rm, Rs=Rm * rng.uniform(0.01, 0.08), Km=Km, D=D, Vmax=supply, J=J, A=A,
        accel=0.6 * top / _log(rng, 0.01, 0.2),
        B=mass * GRAVITY * D * np.pi / 180.0,
        C=A / min(_log(rng, 0.5e-3, 5e-3), 0.1 * travel) ** 2, E=rng.uniform(0.2, 0.8),
        A_loose=A * rng.uniform(0.4, 0.95), J_loose=rng.uniform(turning, 0.5 * (turning + J)),
        stop_low_m=-travel, stop_high_m=2.0 * travel,
    )  # fmt: skip
    ring = 2.0 * np.pi * _log(rng, 3.0, 40.0)
    rig = replace(rig, Kp=2.0 * rng.uniform(0.3, 1.0) * ring * J / Km, Ki=ring**2 * J / Km)
    rate = float(rng.choice([r for r in RATES_HZ if r >= 2.0 * ring]))
    bits = 2.0 ** rng.integers(12, 17, 3)
    steps = np.array([2.4 * supply, 2.4 * supply / Rm, 1.2 * travel]) / bits
    noise = steps * rng.uniform(0.4, 2.0, 3)
    logger = Logger(rate, *noise, log_encoder=drive == "position_servo", encoder_edges=2000)
    speed = 0.6 * top
    return Actuator(
        seed, drive, rig, power, rotor, gear, lead, mass, travel, speed, nominal, logger, tuple(steps), ring / 6.0
    )  # fmt: skip


def data_sheet(actuator: Actuator) -> list[str]:
    """Options of `rig new`: what is printed is 5 % off (1 sigma, cut at 2), what is guessed is within a factor of two."""
    rng = np.random.default_rng([actuator.seed, 15])
    rig = actuator.rig

    def near(value: float) -> float:
        return value * (1.0 + 0.05 * float(np.clip(rng.normal(), -2.0, 2.0)))

    Km = near(rig.Km)
    constant = (
        ["--torque-constant", f"{1e3 * Km:.6g} mNm/A"]
        if rng.random() < 0.5
        else ["--speed-constant", f"{30.0 / np.pi / Km:.6g} rpm/V"]
    )
    options = [
        "--drive", actuator.drive, "--resistance", f"{near(rig.Rm):.6g} ohm", *constant,
        "--rotor-inertia", f"{1e7 * near(actuator.rotor):.6g} gcm2", "--gear", f"{actuator.gear:g}:1",
        "--lead", f"{1e3 * actuator.lead:g} mm", "--mass", f"{near(actuator.mass):.6g} kg",
        "--travel", f"{1e3 * actuator.travel:.6g} mm", "--supply", f"{rig.Vmax:g} V",
    ]  # fmt: skip
    if rng.random() < 0.5:
        options += ["--nominal-current", f"{near(actuator.nominal_current):.6g} A"]
    if rng.random() < 0.5:
        options += ["--friction-force", f"{rig.A / rig.D * 2.0 ** rng.uniform(-1.0, 1.0):.6g} N"]
    if rng.random() < 0.5:
        options += ["--acceleration", f"{rig.accel:.6g} rad/s2"]
    return options


def healthy_spec(actuator: Actuator) -> TruthSpec:
    """A campaign of ten moves at four speeds, each as long as the travel allows."""
    speeds = actuator.speed * np.array((1.0, 0.5, 0.25, 0.75, 1.0))
    holds = [_hold(actuator, speed, 2.0) for speed in speeds]
    rest = _rest(actuator)
    profile = there_and_back(speeds, holds, (0.0,) * len(holds), first_start_s=0.5, rest_s=rest)
    return _spec(actuator, replace(profile, duration_s=profile.duration_s + rest), NO_FAULT)


def fault_spec(actuator: Actuator, label: str, seed: int) -> TruthSpec:
    """One move with a fault of a class of `FAULTS_DRAWN` in the middle of it."""
    rng = np.random.default_rng([actuator.seed, 16, seed, FAULTS_DRAWN.index(label)])
    speed = actuator.speed * rng.uniform(0.4, 1.0)
    hold = _hold(actuator, speed, 5.0)
    profile = there_and_back((speed,), (hold,), (0.0,), first_start_s=0.4, rest_s=_rest(actuator))
    one = replace(profile, moves=profile.moves[:1], duration_s=0.4 + hold + _rest(actuator))
    onset = 0.4 + hold * rng.uniform(0.35, 0.6)
    channels = ("current", "position") if actuator.drive == "current" else ("voltage", "current", "position")
    kinds = {
        "voltage": ("frozen", "gain", "dropout"),
        "current": ("frozen", "gain", "dropout"),
        "position": ("frozen", "gain"),
    }
    fault = NO_FAULT
    if label == "sensor_fault":
        channel = str(rng.choice(channels))
        fault = Fault(label, onset, str(rng.choice(kinds[channel])), channel)
    elif label != "nominal":
        fault = Fault(label, onset)
    return _spec(actuator, one, fault)


def actuator_log(actuator: Actuator, spec: TruthSpec, seed: int) -> tuple[pd.DataFrame, dict]:
    """The log as its user has it: the columns of the drive, in the steps of the logger; and its truth."""
    frame, truth = make_log(spec, seed)
    for column, step in zip(("voltage_v", "current_a", "position_m"), actuator.steps, strict=True):
        frame[column] = np.round(np.round(frame[column] / step) * step, 12)
    return frame[list(KEPT[actuator.drive])], truth


def _spec(actuator: Actuator, profile, fault: Fault) -> TruthSpec:
    loop = actuator.loop if actuator.drive == "position_servo" else 0.0
    return TruthSpec(
        profile, actuator.rig, fault, logger=actuator.logger, servo_hz=SERVO_HZ, substep_hz=SUBSTEP_HZ, Kx=loop
    )  # fmt: skip


def _hold(actuator: Actuator, speed: float, most: float) -> float:
    """Seconds of a move: what the travel leaves, and not less than its ramps."""
    ramp = speed / actuator.rig.accel
    return float(max(min(most, 0.85 * actuator.travel / (actuator.rig.D * speed)), 1.5 * ramp + 0.2))


def _rest(actuator: Actuator) -> float:
    """Seconds until a move has come to rest, and some more."""
    slowest = actuator.speed / actuator.rig.accel + (
        5.0 / actuator.loop if actuator.drive == "position_servo" else 0.0
    )
    return float(round(0.5 + slowest, 3))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
