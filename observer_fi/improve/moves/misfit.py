"""How much of a misfit of simulated moves counts: over the noise, over the dust of imperfections, and on held-out moves."""

import math

import numpy as np

from observer_fi.learn import Experiment, FitResult, objective, residuals, select, without_moves
from observer_fi.numerics import sum_of_squares
from observer_fi.records import Array

_DUST = 0.001
_DUST_NOISE = 0.07
_CLEAR_NOISE = 0.25  # beside the noise of 1: 3 % more scatter
POSITION = 2  # channel
OF_POSITION = ("kinematics", "sensor:position")  # equations that only this channel shows
_CARRIED = ("backlash", "position_lag")  # effects by which a move goes on from all those before it
_POSITION_DUST = 0.05  # its share
_MAKERS = {"Rm": "electrical", "Km": "electrical", "D": "kinematics"}  # the equations that data sheets hold
_TOO_FAR = 5.0  # standard deviations of their priors
GROSS_NATS = 1.0  # a sample, from which on a misfit is gross: effects of any size are tried, and what leaves it is not believed


def samples(experiment: Experiment) -> int:
    """Rows that count, at least 1."""
    return max(int((experiment.weight > 0.0).any(axis=1).sum()), 1)


def excess(experiment: Experiment, r: Array) -> float:
    """Misfit over the noise [nats], less three standard deviations of what white noise alone shows; never negative."""
    n = int((experiment.weight > 0.0).sum())
    return max(0.5 * (sum_of_squares(r) - n) - 3.0 * math.sqrt(0.5 * n), 0.0)


def dust(experiment: Experiment, most: float) -> float:
    """Nats below which nothing is named or told: imperfections of larger causes, and of timing, look like that.

    0.1 % of the baseline's excess `most`, and a misfit of 7 % of the noise; of a quarter where a loop follows a noisy position,
    for not all that it leaves open is noise.
    """
    least = clear(experiment) if experiment.driven.size else imperfection(experiment)
    return max(_DUST * most, least)


def imperfection(experiment: Experiment) -> float:
    """Nats of a misfit of 7 % of the noise, which the timing of a logger or a servo may make."""
    return 0.5 * _DUST_NOISE**2 * int((experiment.weight > 0.0).sum())


def clear(experiment: Experiment) -> float:
    """Nats from which on a misfit is said, however little it is of what was named: a quarter of the noise."""
    return 0.5 * _CLEAR_NOISE**2 * int((experiment.weight > 0.0).sum())


def position_dust(experiment: Experiment, most: float) -> float:
    """The same for a gain in the position alone, 5 % of its noise: the timing of a servo does not reach it [nats]."""
    if experiment.driven.size:
        return dust(experiment, most)
    return max(_DUST * most, 0.5 * _POSITION_DUST**2 * int((experiment.weight[:, POSITION] > 0.0).sum()))


def held_out_residuals(experiment: Experiment, fitted: FitResult) -> Array:
    """(N, 3) residuals of every move under the parameters fitted without it.

    Current and position of its rest are the move's own: no other move can tell them, nor the phase of a shaft there.
    """
    still = np.zeros_like(fitted.nuisance)
    parts = []
    for m in range(experiment.moves):
        model = without_moves(fitted, [m])
        carried = any(model[name] != 0.0 for name in _CARRIED)
        window = (
            list(range(int(np.searchsorted(experiment.log, experiment.log[m])), m + 1)) if carried else [m]
        )
        here = select(experiment, window)
        size = experiment.rows(m).stop - experiment.rows(m).start
        # At the edge of friction a rest may slip with one of the two, for a friction a little different.
        tried = [residuals(here, model, start[window])[-size:] for start in (fitted.nuisance, still)]
        parts.append(min(tried, key=sum_of_squares))
    return np.concatenate(parts)


def channel_excess(experiment: Experiment, r: Array, channel: int) -> float:
    """`excess` of one channel [nats]."""
    n = int((experiment.weight[:, channel] > 0.0).sum())
    return max(0.5 * (float(np.sum(r[:, channel] ** 2)) - n) - 3.0 * math.sqrt(0.5 * n), 0.0)


def raw_excess(experiment: Experiment, r: Array, channel: int | None = None) -> float:
    """Misfit over the noise [nats], of all or of one channel; negative where the noise was less than expected."""
    chosen = slice(None) if channel is None else channel
    n = int((experiment.weight[:, chosen] > 0.0).sum())
    return 0.5 * (float(np.sum(r[:, chosen] ** 2)) - n)


def sees_voltage(experiment: Experiment) -> bool:
    """Whether any voltage was read."""
    return bool((experiment.weight[:, 0] > 0.0).any())


def disregard(experiment: Experiment, fitted: FitResult) -> float:
    """Nats by which a fit leaves what is known of the rig; nothing without a voltage: see `bent`."""
    return objective(fitted.model, fitted.free, np.zeros(1)) if sees_voltage(experiment) else 0.0


def missed(experiment: Experiment, fitted: FitResult) -> float:
    """Nats that a fit misses by, in the readings and in what is known of the rig."""
    return excess(experiment, fitted.residuals) + disregard(experiment, fitted)


def bent(experiment: Experiment, fitted: FitResult) -> tuple[str, ...]:
    """Equations whose constants of the data sheet a refit moved by more than their makers ever do.

    Without a voltage those of the winding come from when the supply limits, which a servo's ticks blur.
    """
    far = [
        f.name
        for f in fitted.free
        if f.name in _MAKERS and abs(fitted.model[f.name] - f.prior) > _TOO_FAR * f.prior_std
    ]
    blind = set() if sees_voltage(experiment) else {"electrical"}
    return tuple(dict.fromkeys(_MAKERS[name] for name in far if _MAKERS[name] not in blind))
