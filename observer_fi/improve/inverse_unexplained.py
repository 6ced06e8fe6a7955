"""What a residual force still depends on when every cause has been asked."""

import math
from collections.abc import Sequence

import numpy as np

from observer_fi.learn import Motion, Solution
from observer_fi.physics import Rig
from observer_fi.records import Array


def unexplained(
    motions: Sequence[Motion], solution: Solution, rig: Rig, smallest: float
) -> tuple[tuple[str, float], ...]:
    """What the residual still depends on: regressor and share of its variance that the regressor predicts.

    Each part of the logs is predicted by the mean in twenty-four classes of the regressor over the other parts, so
    that a share above zero is no accident of the fit. smallest: share that is worth a line.
    """
    part, found = solution.part, []
    for name, values in regressors(motions, rig).items():
        share = _predictable(solution.residual, values, part)
        if share >= smallest:
            found.append((name, share))
    return tuple(sorted(found, key=lambda item: -item[1]))


def regressors(motions: Sequence[Motion], rig: Rig) -> dict[str, Array]:
    """(N,) class of each fitted sample, by name of regressor.

    position: per direction. direction: distance since the last reversal, per direction. angles: per log, for their zero is
    arbitrary. current: the commanded drive. Constant ones are left out.
    """
    D, rows = rig.model["D"], [m.kept for m in motions]
    x, v, force, theta = (
        np.concatenate([getattr(m, name)[k][m.use] for m, k in zip(motions, rows, strict=True)])
        for name in ("x", "v", "force", "theta")
    )
    log = np.concatenate([np.full(np.count_nonzero(m.use), j) for j, m in enumerate(motions)])
    forward = 100.0 * (v > 0.0)
    since = np.concatenate([_since_reversal(m)[k][m.use] for m, k in zip(motions, rows, strict=True)])
    turn = np.floor(24.0 * ((x / (2.0 * math.pi * D)) % 1.0)) + 1000.0 * log
    found = {
        "speed": _classes(v, 24),
        "position": _classes(x, 24) + forward,
        "direction": _classes(np.log10(np.maximum(since, 1e-7)), 12) + forward,
        "shaft_angle": turn,
        "current": _classes(force, 24),
        "pitch": _classes(theta, 24),
    }
    if "screw_lead" in rig.quantities:
        found["screw_angle"] = (
            np.floor(24.0 * ((x / rig.quantities["screw_lead"].value) % 1.0)) + 1000.0 * log
        )
        if np.array_equal(found["screw_angle"], turn):
            del found["screw_angle"]
    return {name: values for name, values in found.items() if np.ptp(values) > 0.0}


def _classes(values: Array, count: int) -> Array:
    """Number of the class of each value, classes of equal size."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1]))
    return np.searchsorted(edges, values).astype(np.float64)


def _since_reversal(motion: Motion) -> Array:
    """(n,) distance travelled since the direction last changed [m]."""
    turned = np.flatnonzero(np.diff(np.sign(motion.v)) != 0.0) + 1
    last = np.zeros(motion.v.size, dtype=np.int64)
    last[turned] = turned
    return np.abs(motion.x - motion.x[np.maximum.accumulate(last)])


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
