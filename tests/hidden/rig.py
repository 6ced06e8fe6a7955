"""The mass-shifter's constants (Table 1 of the paper) and how they vary from rig to rig."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Rig:
    """Constants of one rig, SI units except pitch in degrees. Letters as in the paper.

    Rm, Rs [ohm], Km [N m/A], D [m/rad], Vmax [V], accel [rad/s^2], Kp [A s/rad], Ki [A/rad], J [kg m^2],
    A [N m], B [N m/deg], C [N m/m^2], E [1]; A_loose, J_loose are A', J' after a coupling loss; the stops are
    positions of the mass [m] at which each end touches. L [H]: of the winding, which the paper leaves out.
    """

    Rm: float = 20.2
    Rs: float = 0.8
    Km: float = 21.2e-3
    D: float = 1.9e-6
    Vmax: float = 15.1
    accel: float = 6e4
    Kp: float = 1.1e-3
    Ki: float = 0.45
    J: float = 4.7e-7
    A: float = 4.6e-4
    B: float = 2.3e-5
    C: float = 85.0
    E: float = 0.52
    A_loose: float = 3.4e-4
    J_loose: float = 4.6e-7
    stop_low_m: float = -0.05
    stop_high_m: float = 0.05
    L: float = 0.0


TABLE_1 = Rig()
SCREW_LEAD_M = 1e-3  # Nook lead screw, 1 mm a turn
SCREW_RAD_PER_MOTOR_RAD = 2 * np.pi * TABLE_1.D / SCREW_LEAD_M  # one screw turn = 526.3 motor rad


def draw_rig(rng: np.random.Generator, identification_percent: float = 0.0, base: Rig = TABLE_1) -> Rig:
    """A rig with the paper's spread (1 sigma): A, B, A' 10 %, C 15 %, E 5 %, each stop 1 mm.

    identification_percent: 1-sigma spread [%] of J (and J' with it), Kp, Ki, Rs and Vmax as well.
    Draws are cut at 3 sigma, so that a rig always moves and always holds its pitch.
    """
    extra = identification_percent / 100.0
    inertia = _factor(rng, extra)
    return replace(
        base,
        A=base.A * _factor(rng, 0.10),
        B=base.B * _factor(rng, 0.10),
        A_loose=base.A_loose * _factor(rng, 0.10),
        C=base.C * _factor(rng, 0.15),
        E=base.E * _factor(rng, 0.05),
        stop_low_m=base.stop_low_m + 1e-3 * _cut_normal(rng),
        stop_high_m=base.stop_high_m + 1e-3 * _cut_normal(rng),
        J=base.J * inertia,
        J_loose=base.J_loose * inertia,
        Kp=base.Kp * _factor(rng, extra),
        Ki=base.Ki * _factor(rng, extra),
        Rs=base.Rs * _factor(rng, extra),
        Vmax=base.Vmax * _factor(rng, extra),
    )


def draw_rest_integral(rng: np.random.Generator, rig: Rig, pitch_deg: float) -> float:
    """Error integral I [rad] of a mass at rest: anywhere in 90 % of the band that friction holds."""
    torque = rig.B * pitch_deg + rng.uniform(-0.9, 0.9) * rig.A
    return float(torque / (rig.Km * rig.Ki))


def _cut_normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.normal(), -3.0, 3.0))


def _factor(rng: np.random.Generator, sigma: float) -> float:
    return 1.0 + sigma * _cut_normal(rng)
