"""All that a position servo commands, in moves cut where its command is too low to move a motor (docs/decisions/0028)."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from observer_fi.learn.move_data import REST_ROWS, Experiment, knots_of
from observer_fi.numerics import resolution_of
from observer_fi.physics import Rig, whole_command
from observer_fi.records import Log


def with_whole_command(experiment: Experiment, logs: Sequence[Log], rig: Rig) -> Experiment:
    """The experiment whose moves are cut where a position servo's goal moves, with all that it commands in between.

    What it creeps up to its goal with at last is no move of its own, but drives the motor. The steps of the encoder that it is
    made of count as noise of what the servo makes of them (equations 3 and 4). logs: as `prepare` took them. Of
    another drive the experiment itself.
    """
    if rig.driven.command is None:
        return experiment
    whole = [_without_creep_at_rest(experiment, k, log, rig) for k, log in enumerate(logs)]
    model = rig.model
    current = max(_encoder_noise(log) for log in logs) * model["Kx"] * model["Kp"]
    noise = np.hypot(experiment.noise, current * np.array([model["Rm"], 1.0, 0.0]))
    experiment = _from_the_end_of_rests(experiment)
    return replace(
        experiment,
        knots=tuple(knots_of(log, rig) for log in whole),
        noise=noise,
        weight=experiment.weight * experiment.noise / noise,
    )


def _without_creep_at_rest(experiment: Experiment, number: int, log: Log, rig: Rig) -> Log:
    """A log with its whole command, but for the rests from which its moves are simulated.

    There the motor holds at the edge of friction, and what a simulation begins with may slip or not.
    """
    w = whole_command(log, rig).copy()
    for m in np.flatnonzero(experiment.log == number).tolist():
        first = int(experiment.bounds[m])
        begin, start = experiment.t[[first, first + int(experiment.moving[m])]]
        rest = (log.t >= begin) & (log.t < start)
        w[rest] = log.w_cmd[rest]
    return replace(log, w_cmd=w)


def _from_the_end_of_rests(experiment: Experiment) -> Experiment:
    """The experiment whose moves begin with the last readings of their rests, in which a loop creeps on."""
    weight, rest = experiment.weight.copy(), experiment.rest.copy()
    for m, moving in enumerate(experiment.moving.tolist()):
        first = int(experiment.bounds[m])
        last = slice(first + max(moving - REST_ROWS, 0), first + moving)
        read = weight[last, 1] > 0.0
        if read.any():
            rest[m, 0] = experiment.z[last, 1][read].mean()
            weight[first : last.start, :2] = 0.0
    return replace(experiment, weight=weight, rest=rest)


def _encoder_noise(log: Log) -> float:
    """Standard deviation of what the steps of a log's encoder are off [rad]."""
    step = None if log.encoder is None else resolution_of(np.diff(log.encoder))
    return (step or 0.0) / math.sqrt(12.0)
