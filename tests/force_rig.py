"""A force-driven rig of its own: carriage, controller at 1 kHz, friction in force units, its own integrator.

Shares no code with the package: 20 substeps a sample, friction that builds up within 0.2 um.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from observer_fi.physics.rigs import Quantity, Rig
from observer_fi.records import Log

MASS, COULOMB, TURN = 80.0, 18.0, 2e-3
D = TURN / (2.0 * math.pi)
STEP = 1e-3


@dataclass(frozen=True)
class Truth:
    """Forces [N], N s/m, m/s, m, s. delay: from the command's change to the force's. field: N/m, a spring.

    saturating: a drag that grows up to some times local_speed, by another law than the model's.
    """

    forward: float = 0.0
    backward: float = 0.0
    local: float = 0.0
    local_speed: float = 0.01
    ripple: float = 0.0
    phase: float = 1.0
    delay: float = 0.0
    field: float = 0.0
    offset: float = 0.0
    noise: float = 1e-8
    saturating: float = 0.0


@njit
def _run(reference, noise, c):
    forward, backward, local, local_speed, ripple, phase, delay, field, offset, saturating = c
    n, sub = reference.size, 20
    h = STEP / sub
    x, v, s, held = reference[0], 0.0, 0.0, 0.0
    seen, force = np.empty(n), np.empty(n)
    for k in range(n):
        seen[k] = round((x + noise[k]) / 5e-8) * 5e-8
        rate = (seen[k] - seen[k - 2]) / (2 * STEP) if k > 1 else 0.0
        want = 8e3 * (150.0 * (reference[k] - seen[k]) - rate)
        force[k] = want
        for j in range(sub):
            drive = want if (j + 0.5) * h > delay else held
            friction = s * (COULOMB + local * math.exp(-((v / local_speed) ** 2)))
            friction += saturating * math.copysign(1.0 - math.exp(-abs(v) / local_speed), v)
            friction += (forward if v > 0 else backward) * v + offset + field * x
            friction += ripple * math.sin(2 * math.pi * x / TURN + phase)
            v += h * (drive - friction) / MASS
            moved = h * v
            x += moved
            s += (np.sign(moved) - s) * (1.0 - math.exp(-abs(moved) / 2e-7))
        held = want
    return seen, force


def reference(seconds: float, seed: int) -> np.ndarray:
    """Strokes of 20 to 180 mm at 20 to 150 mm/s, with smooth ends."""
    rng = np.random.default_rng(seed)
    parts, here = [], 0.0
    while sum(map(len, parts)) < seconds / STEP:
        there = rng.uniform(0.0, 0.2)
        if abs(there - here) < 0.02:
            continue
        n = round(abs(there - here) / rng.uniform(0.02, 0.15) / STEP) + 300
        u = np.linspace(0.0, 1.0, n)
        parts.append(here + (there - here) * u**3 * (10 - 15 * u + 6 * u * u))
        here = there
    return np.concatenate(parts)[: round(seconds / STEP)]


def log(truth: Truth, seconds: float = 20.0, seed: int = 1) -> Log:
    """A log of commanded force and position."""
    wanted = reference(seconds, seed)
    noise = truth.noise * np.random.default_rng(1000 + seed).standard_normal(wanted.size)
    c = (
        truth.forward,
        truth.backward,
        truth.local,
        truth.local_speed,
        truth.ripple,
        truth.phase,
        truth.delay,
    )
    seen, force = _run(wanted, noise, np.array([*c, truth.field, truth.offset, truth.saturating]))
    z = np.full((wanted.size, 3), np.nan)
    z[:, 2] = seen
    t = STEP * np.arange(wanted.size)
    return Log(f"seed{seed}", t, z, np.full(t.size, np.nan), np.zeros(t.size), force=force)


DRAG = 150.0
VISCOUS = {
    "viscous_positive": Quantity(DRAG * D**2, "N m s/rad"),
    "viscous_negative": Quantity(DRAG * D**2, "N m s/rad"),
}


def rig(**quantities: Quantity) -> Rig:
    """Inertia and Coulomb friction a tenth off, the hold of the controller known."""
    base = {
        "J": Quantity(0.9 * MASS * D**2, "kg m^2"),
        "A": Quantity(0.9 * COULOMB * D, "N m"),
        "D": Quantity(D, "m/rad"),
        "input_delay": Quantity(5e-4, "s"),
    }
    return Rig("bench", "", "force", base | quantities)
