"""At which angle of the motor a log begins, as far as its ripples ask for it: the first motion of the log tells.

A ripple of the motor's turn, or of a stage of its gear, has its phase from an angle that no sensor shows: every log begins at
another one. A position whose noise or step is a good part of what the mass makes in a turn leaves it open, and a ripple that
is out of phase is a fault at every start.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from observer_fi.bank import Bank, bank
from observer_fi.physics import Rig, equations, with_values
from observer_fi.records import Log
from observer_fi.settings import BankSettings

SHOWN_S = 0.25  # of the first motion, at least
TURNS = 2.0  # of the slowest ripple, that are looked at where the motion has them
COARSE, FINE = 16, 8  # phases of a turn that are tried, and between two of these
PASSES = 2  # over all ripples: each is looked for beside the others


class Phases(NamedTuple):
    """By how much the motor, the stage of its gear, and the angle of an empirical curve are ahead as a log begins [rad]."""

    shaft: float = 0.0
    gear: float = 0.0
    curve: float = 0.0

    def of(self, rig: Rig) -> Rig:
        """The rig with its ripples as they are in that log."""
        model = rig.model
        values = {
            f"{name}_ripple_{part}": value
            for name, angle in (("shaft", self.shaft), ("gear", self.gear))
            if angle
            for part, value in _turned(model[f"{name}_ripple_sin"], model[f"{name}_ripple_cos"], angle)
        }
        if self.curve:
            values["curve_first"] = model["curve_first"] - self.curve
        return with_values(rig, values) if values else rig


def _turned(of_sin: float, of_cos: float, angle: float) -> Iterable[tuple[str, float]]:
    """Amplitudes of a ripple that is ahead by an angle."""
    s, c = math.sin(angle), math.cos(angle)
    return ("sin", of_sin * c - of_cos * s), ("cos", of_sin * s + of_cos * c)


def phases_of(log: Log | None, rig: Rig, settings: BankSettings) -> Phases:
    """Those that explain the first motion of a log best, by the nominal filter from the first sample on.

    None is ahead where the rig has no ripple of its motor's angle, or there is no motion.
    """
    orders = _orders(rig)
    if log is None or not orders or not log.w_cmd.any():
        return Phases()
    first = int(np.argmax(log.w_cmd != 0.0))
    begun = log.part(slice(0, _last(log, first, min(orders.values()))))

    def nats(phases: Phases) -> float:
        turned = phases.of(rig)
        e = Bank(turned, settings, hypotheses=bank(turned, settings)[:1]).advance(begun)
        return float(np.nansum(e.density[first:, 0]))

    best, step = Phases(), 2.0 * math.pi / COARSE
    for width in (step,) * (PASSES if len(orders) > 1 else 1) + (step / FINE,):
        count = COARSE if width == step else FINE
        for name in orders:
            around = [getattr(best, name) + width * k for k in range(-count // 2 + 1, count // 2 + 1)]
            best = max((best._replace(**{name: angle}) for angle in around), key=nats)
    return best


def _orders(rig: Rig) -> dict[str, float]:
    """What of a rig repeats with the angle of its motor, and how often a turn."""
    model = rig.model
    found = {
        name: model[f"{name}_order"]
        for name in ("shaft", "gear")
        if model[f"{name}_ripple_sin"] or model[f"{name}_ripple_cos"]
    }
    over_shaft = model["curve_of"] != 0.0 and model["curve_over"] == equations.SHAFT_ANGLE
    return found | ({"curve": 1.0} if over_shaft else {})


def _last(log: Log, first: int, order: float) -> int:
    """The sample behind what is looked at of a motion that begins at sample `first`: its slowest ripple has turned there."""
    turned = np.cumsum(np.abs(log.w_cmd[first:-1]) * np.diff(log.t[first:])) * order
    enough = first + int(np.searchsorted(turned, 2.0 * math.pi * TURNS)) + 1
    rest = np.flatnonzero(log.w_cmd[first:] == 0.0)
    stop = first + int(rest[0]) if rest.size else log.t.size
    least = int(np.searchsorted(log.t, log.t[first] + SHOWN_S))
    return min(max(enough, least), stop)
