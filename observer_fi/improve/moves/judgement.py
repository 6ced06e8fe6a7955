"""Whether a trial is believed: it matters beside what is left, a ripple is a line, and no smooth term does much better."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from observer_fi.improve.moves.lines import MOST_OF_IT, line_by_move, lines_of
from observer_fi.improve.moves.misfit import POSITION, channel_excess, excess, raw_excess
from observer_fi.improve.moves.unexplained import smooth_terms
from observer_fi.improve.steps import Trial
from observer_fi.learn import TORQUE, Experiment, FitResult
from observer_fi.physics import FEWEST_PERIODS

# Of fourteen effects without a ripple (seeds 711007 to 711020) no line with nats to speak of but that of a bent screw is stronger
# than the sixth strongest by more than half; or a ripple explains the most of the misfit.
_LINES, _STANDS_OUT = 6, 1.8


_SAME_ORDER = 0.01  # relative, within which two lines are one
_FALL = 0.1  # of the Stribeck torque, by which friction falls somewhere


@dataclass(frozen=True)
class MoveSettings:
    """What it takes to name a cause.

    share: of the excess misfit (over the noise) that a cause must explain, or channel_share of it in one channel. held_out:
    share of the gain that must be seen on held-out moves. close: nats, per unit of the residuals' inflation, within
    which a rival cannot be told apart. rivals: how many are refitted in a round. margin: nats over the penalty. A cause
    is refused where one smooth term gains smooth_factor times as much, smooth_nats more, and smooth_share of all: the
    truth is then outside the vocabulary.
    """

    share: float = 0.25
    channel_share: float = 0.5
    held_out: float = 0.3
    close: float = 6.0
    rivals: int = 6
    rounds: int = 6
    margin: float = 10.0
    smooth_factor: float = 1.15
    smooth_share: float = 0.6
    smooth_nats: float = 40.0


def matters(
    experiment: Experiment,
    before: FitResult,
    after: FitResult,
    least: tuple[float, float],
    settings: MoveSettings,
) -> bool:
    """Whether the gain is a good part of the misfit that is left, in all or in one channel, and not dust of the whole.

    least: nats that a cause must gain, in all or in the position alone.
    """
    gain = before.objective - after.objective
    won = 0.5 * np.sum(before.residuals**2 - after.residuals**2, axis=0)
    if gain < least[0] and min(gain, won[POSITION]) < least[1]:
        return False
    if gain >= settings.share * excess(experiment, before.residuals):
        return True
    for c in range(3):
        left = channel_excess(experiment, before.residuals, c)
        if left > 0.0 and won[c] >= settings.channel_share * left:
            return True
    return False


def only_bends(experiment: Experiment, trial: Trial[FitResult]) -> bool:
    """Whether what looks like friction of low speeds is the bend of a drag that rises all the way to the fastest move.

    friction(w) = b w + T' tanh(w / w') + T exp(-(w / ws)^2), b of both directions: Stribeck's has a falling branch.
    """
    if "stribeck_friction" not in trial.causes:
        return False
    model = trial.fitted.model
    w = np.linspace(0.0, float(np.abs(experiment.peak).max()), 200)
    friction = 0.5 * (model["viscous_positive"] + model["viscous_negative"]) * w
    friction += model["saturating_drag"] * np.tanh(w / model["saturation_speed"])
    friction += model["stribeck_torque"] * np.exp(-((w / model["stribeck_speed"]) ** 2))
    fall = float(np.max(np.maximum.accumulate(friction) - friction))
    return fall < _FALL * model["stribeck_torque"]


def is_no_scale(experiment: Experiment, trial: Trial[FitResult]) -> bool:
    """Whether a gain of the position and a part of a period together are what a sensor that is not linear has as well."""
    model = trial.fitted.model
    wave = math.hypot(model["position_sin"], model["position_cos"])
    x = experiment.z[experiment.weight[:, POSITION] > 0.0, POSITION]
    if wave == 0.0 or model["position_gain"] == 1.0 or x.size == 0:
        return False
    return bool(np.ptp(x) < FEWEST_PERIODS * model["position_period"])


def is_no_line(experiment: Experiment, fitted: FitResult, trial: Trial[FitResult]) -> bool:
    """Whether a ripple of any order is one of many that do as well, and none of them explains the most of what is left.

    What comes with each start or stop comes at the same angles again and again, and has a little of every order. Of a ripple of
    a high order, whose phase is another in every move, a lower one takes what it can.
    """
    model = trial.fitted.model
    orders = {
        "gear_ripple": model["gear_order"], "shaft_ripple": model["shaft_order"],
        "screw_ripple": 2.0 * math.pi * model["D"] / model["screw_lead"],
    }  # fmt: skip
    here = next((orders[name] for name in trial.causes if name in orders), None)
    if here is None:
        return False
    other = line_by_move(experiment, fitted, TORQUE)
    if other is not None and other.gain > trial.gain and abs(other.at - here) > _SAME_ORDER * here:
        return True
    if "gear_ripple" not in trial.causes or trial.gain >= MOST_OF_IT * excess(experiment, fitted.residuals):
        return False
    *lines, background = lines_of(experiment, fitted, _LINES)
    order = min(lines, key=lambda line: abs(line.at - here))
    return order.gain < _STANDS_OUT * background.gain


def smooth_is_better(
    experiment: Experiment,
    before: FitResult,
    trial: Trial[FitResult],
    second: Callable[[], float],
    settings: MoveSettings,
) -> bool:
    """Whether one smooth term explains nearly all that is left where the cause, or it and a second one, explain far less.

    second: what another cause gains beside the first [nats].
    """
    left, gain = raw_excess(experiment, before.residuals), trial.gain
    if settings.smooth_factor * gain > 1.1 * left:
        return False
    best = smooth_terms(experiment, before, left)[0]
    more = best.held_out - gain
    if more <= max(settings.smooth_nats, (settings.smooth_factor - 1.0) * gain):
        return False
    return best.held_out > settings.smooth_share * left and gain + second() < best.held_out
