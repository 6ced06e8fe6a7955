"""What paths of a whole move may be called, and what each name is worth."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from observer_fi.physics import FAULTS, NOMINAL, UNKNOWN, OwnState, channel_of, label_of
from observer_fi.records import CHANNELS, Event
from observer_fi.verdict.moves.whole_move import Path, WholeMove

# By which a load and a slip at will must be better than a fault with a name: nats, and a share of what is gained, for how a
# fault grows is no part of its model.
RARE_NATS, AT_WILL = math.log(10.0), 2e-3
OF_SENSORS = {label for label, row in FAULTS.items() if row.by_channel}
FINER = 0.85  # times the misfit of a slip, that of a sensor which is as likely
LEARNED = 0.5  # of its prior's width, from which a constant still has it: where it then lies is where its filter began
AS_WELL = 1.1  # times the misfit of a jam, that of a spring of about the right law
NO_LOSS, FOLLOWS = 0.03, 3.0  # share of the travel, and standard deviations of it, that is as good as none
SHARPEST = 1e-9  # of its prior: what is left of a constant that no reading can change


class Story(NamedTuple):
    """What a path is called: the hypothesis, and its nats over nominal."""

    mode: str
    gain: float
    path: Path


def constant(path: Path, own: OwnState) -> tuple[float, float]:
    """A constant of a fault at the end of its path, and its standard deviation; absolute ones in their unit.

    The torque of a stop is that of its depth, whatever the sign of its stiffness.
    """
    k = path.hypothesis.states.index(own.name)
    unit = own.mean if own.absolute else 1.0
    value = unit * float(path.memory.x[k])
    value = value if own.absolute or own.of_friction else abs(value)
    return value, unit * math.sqrt(max(float(path.memory.P[k, k]), 0.0))


def special_case(path: Path, own: OwnState, value: float) -> float:
    """Nats by which a constant that is exactly `value` explains the move better than one that is free."""
    mean, std = constant(path, own)
    prior = own.std or 1.0
    std = max(std, SHARPEST * prior)
    after = -0.5 * ((value - mean) / std) ** 2 - math.log(std)
    return after + 0.5 * ((value - own.mean) / prior) ** 2 + math.log(prior)


def of_any_decade(path: Path, own: OwnState) -> float:
    """Nats by which a constant that differs by decades, log-normal, explains the move better than its Gaussian prior.

    The ratio of the two priors, averaged over the posterior: a soft obstacle is as likely as a hard one, and where readings leave
    next to nothing of it the width of a Gaussian for hard ones must not count against it. Beyond two standard deviations the
    Gaussian stays: what is as hard as that is no obstacle, but a rise of the friction with another name.
    """
    if not own.factor or own.std is None:
        return 0.0
    mean, std = constant(path, own)
    if std > LEARNED * own.std:
        return 0.0
    std = max(std, SHARPEST * own.std)
    c = mean + std * np.linspace(-6.0, 6.0, 601)
    c = c[c > 0.0]
    width = math.log(own.factor)
    after = -0.5 * ((c - mean) / std) ** 2 - math.log(std)
    gaussian = -0.5 * ((c - own.mean) / own.std) ** 2 - math.log(own.std)
    wide = -0.5 * (np.log(c / own.mean) / width) ** 2 - np.log(c * width)
    nats = (
        after + np.where(c < own.mean * own.factor**2, wide - gaussian, 0.0) - 0.5 * math.log(2.0 * math.pi)
    )
    return float(nats.max() + math.log(np.trapezoid(np.exp(nats - nats.max()), c)))


def measured(story: Story, whole: WholeMove) -> bool:
    """Whether the channel that has failed, if one has, is there at all."""
    channel = channel_of(story.mode)
    return channel is None or bool(np.isfinite(whole.window.z[:, CHANNELS.index(channel)]).any())


def worth(story: Story) -> float:
    """Nats of a story over nominal, less what a load at will must be better by."""
    at_will = label_of(story.mode) == UNKNOWN
    return story.gain - (RARE_NATS + AT_WILL * story.gain if at_will else 0.0)


def posterior_of(event: Event, stories: Sequence[Story]) -> dict[str, float]:
    """Probability of each label: its best story against nominal and the others'.

    How a sensor fails, or a jam grows, is no part of its model. A resistance that grows with the travel of a mass which follows
    the motor whole is a jam as well as a spring, until the mass turns back. A failed sensor and a slip look alike at one speed:
    where the sensor explains what it believes better than the slip all channels, and next to as much as the best, less than that
    share of what is gained says nothing.
    """
    best = _best_of(stories)
    nats = {NOMINAL: 0.0} | {label: worth(story) for label, story in best.items()}
    top = max(nats.values())
    if _spring_or_jam(best, top):
        nats |= {"jam": top, "overload": top}
    for label in OF_SENSORS & best.keys():
        slip = best.get("slip")
        near = {k: top for k in (label, "slip") if k in nats and top - nats[k] < AT_WILL * top}
        if slip is not None and label in near and _misfit(best[label].path) < FINER * _misfit(slip.path):
            nats |= near
    weights = {label: math.exp(nats.get(label, -math.inf) - top) for label in event.posterior}
    total = sum(weights.values())
    return {label: weight / total for label, weight in weights.items()}


def in_order(stories: Sequence[Story]) -> list[Story]:
    """Stories, the most likely first; of a spring and a jam that are alike the jam, which may grow in any way."""
    out, best = sorted(stories, key=lambda s: -worth(s)), _best_of(stories)
    if out and label_of(out[0].mode) == "overload" and _spring_or_jam(best, worth(out[0])):
        out.remove(best["jam"])
        out.insert(0, best["jam"])
    return out


def _best_of(stories: Sequence[Story]) -> dict[str, Story]:
    """The best story of each label."""
    return {label_of(story.mode): story for story in sorted(stories, key=worth)}


def _spring_or_jam(best: Mapping[str, Story], top: float) -> bool:
    """Whether the best stories, of which one is worth `top`, leave a spring that the mass follows into and a jam that grows."""
    if not {"jam", "overload"} <= best.keys() or top > max(worth(best[k]) for k in ("jam", "overload")):
        return False
    spring, jam = best["overload"], best["jam"]
    near = abs(worth(spring) - worth(jam)) < AT_WILL * top
    # A spring with a load in front of it follows a jam, however it grows: where it is the better one that says nothing.
    says = not takes_up_any_load(spring.path) or worth(spring) > worth(jam)
    as_well = says and _misfit(spring.path) < AS_WELL * _misfit(jam.path)
    return follows_whole(spring.path) and (near or as_well)


def takes_up_any_load(path: Path) -> bool:
    """Whether what a path explains says little: a fault that follows anything, or an obstacle with a load in front of it."""
    own = {o.name for o in path.hypothesis.own}
    return path.hypothesis.label == UNKNOWN or {"C", "torque"} <= own


def load_of_a_spring(path: Path) -> tuple[float, float]:
    """Size of what a spring, with or without a load in front of it, presses at the end of its path, and its standard deviation
    [N m].

    Stiffness and load may each be in doubt where their sum is not.
    """
    stiffness = next(own for own in path.hypothesis.own if own.name == "C")
    names = [name for name in ("d", "C", "torque") if name in path.hypothesis.states]
    at = [path.hypothesis.states.index(name) for name in names]
    d, stiff, *load = path.memory.x[at]
    per_C = (
        math.copysign(stiffness.told_as.value(path.hypothesis.model), stiff) * d if stiffness.told_as else 0.0
    )
    c, P = np.array([per_C, *(1.0 for _ in load)]), path.memory.P[np.ix_(at[1:], at[1:])]
    return abs(per_C * float(stiff) + float(sum(load))), math.sqrt(max(float(c @ P @ c), 0.0))


def follows_whole(path: Path) -> bool:
    """Whether the mass that presses against an obstacle loses none of its travel by it."""
    lost, std = constant(path, next(own for own in path.hypothesis.own if own.name == "E"))
    return abs(lost - path.before) < max(NO_LOSS, FOLLOWS * std)


def _misfit(path: Path) -> float:
    """Mean normalised innovation squared of a channel that a path believes."""
    return path.nis / (len(CHANNELS) - (path.hypothesis.failed >= 0))
