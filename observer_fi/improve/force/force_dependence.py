"""What a calculated force still depends on once its causes are named: class means over a regressor, judged on other parts."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer_fi.improve.steps import Smooth
from observer_fi.learn import Motion, Solution
from observer_fi.physics import Rig
from observer_fi.records import Array


def follows(motions: Sequence[Motion], solution: Solution, rig: Rig, smallest: float) -> tuple[Smooth, ...]:
    """What the residual still depends on, as a torque: every regressor that predicts a share of its variance.

    Each part of the logs is predicted by the mean in classes of the regressor over the other parts, so that a share above zero
    is no accident of the fit. smallest: share that is worth a line.
    """
    parts = [m.v[m.kept][m.use] for m in motions]
    forward = np.concatenate(parts) > 0.0
    log = np.repeat(np.arange(len(motions)), [part.size for part in parts])
    found = []
    for name, (values, directed) in motion_regressors(motions, rig).items():
        own = forward if directed else log if name.endswith("_angle") else np.zeros(log.size)
        classes = _classes(values, 12 if name == "direction" else 24) + 1000.0 * own
        share = _predictable(solution.residual, classes, solution.part)
        if np.ptp(values) > 0.0 and share >= smallest:
            found.append(_followed(name, values, directed, forward, share, solution, rig.model["D"]))
    return tuple(sorted(found, key=lambda term: -term.share))


def motion_regressors(motions: Sequence[Motion], rig: Rig) -> dict[str, tuple[Array, bool]]:
    """(N,) what a force may depend on at each fitted sample, and whether in each direction by itself.

    direction: decades of the distance [m] since the last reversal. current: the commanded force [N]. Constant ones are left out.
    """
    D = rig.model["D"]
    x, v, force, theta, since = (
        np.concatenate([values(m)[m.kept][m.use] for m in motions])
        for values in (
            lambda m: m.x, lambda m: m.v, lambda m: m.force, lambda m: m.theta, _since_reversal,
        )
    )  # fmt: skip
    found = {
        "speed": (v / D, False),
        "position": (x, True),
        "direction": (np.log10(np.maximum(since, 1e-7)), True),
        "shaft_angle": (np.mod(x / D, 2.0 * math.pi), False),
        "current": (force, False),
        "pitch": (theta, False),
    }
    if "screw_lead" in rig.quantities:
        lead = rig.model["screw_lead"]
        if abs(lead / (2.0 * math.pi * D) - 1.0) > 1e-6:
            found["screw_angle"] = (np.mod(2.0 * math.pi * x / lead, 2.0 * math.pi), False)
    return {name: (values, way) for name, (values, way) in found.items() if np.ptp(values) > 0.0}


def _since_reversal(motion: Motion) -> Array:
    """(n,) distance travelled since the direction last changed [m]."""
    turned = np.flatnonzero(np.diff(np.sign(motion.v)) != 0.0) + 1
    last = np.zeros(motion.v.size, dtype=np.int64)
    last[turned] = turned
    return np.abs(motion.x - motion.x[np.maximum.accumulate(last)])


def _classes(values: Array, count: int) -> Array:
    """Number of the class of each value, classes of equal size."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    return np.searchsorted(edges, values).astype(np.float64)


def _predictable(residual: Array, classes: Array, part: Array) -> float:
    """Share of the variance of each part that class means of the other parts predict."""
    _, index = np.unique(classes, return_inverse=True)
    predicted = np.zeros_like(residual)
    for k in np.unique(part):
        out = part == k
        count = np.bincount(index[~out], minlength=index.max() + 1)
        total = np.bincount(index[~out], residual[~out], minlength=index.max() + 1)
        predicted[out] = (total / np.maximum(count, 1))[index[out]]
    return 1.0 - float(np.sum((residual - predicted) ** 2) / np.sum(residual**2))


def _followed(
    name: str,
    values: Array,
    directed: bool,
    forward: NDArray[np.bool_],
    share: float,
    solution: Solution,
    D: float,
) -> Smooth:
    """A share as a curve of the torque [N m] over the regressor, against the direction of motion where it follows that."""
    torque = D * solution.residual * (np.where(forward, 1.0, -1.0) if directed else 1.0)
    k = _classes(values, 24).astype(np.int64)
    count = np.maximum(np.bincount(k), 1)
    mean, at = np.bincount(k, torque) / count, np.bincount(k, values) / count
    spread = np.sqrt(np.bincount(k, (torque - mean[k]) ** 2) / count)
    gain = -0.5 * values.size * math.log(max(1.0 - share, 1e-12))
    return Smooth("torque", name, directed, gain, gain, share, at, mean, spread / np.sqrt(count), count.size)
