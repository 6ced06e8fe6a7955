"""Every log begins at another angle of its motor: a ripple learned on one log is looked for at its own phase on the next."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hidden import draw_move_case, effect, make_log

from observer_fi.logs import log_from_frame
from observer_fi.physics import Rig, load_rig, with_values
from observer_fi.records import Log
from observer_fi.settings import BankSettings, Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.as_logged import AsLogged
from observer_fi.verdict.moves.ripple_phase import Phases, phases_of

RIG = load_rig()
TORQUE = 4e-5  # N m: what campaigns on recordings have shown


def rippled(order: float = 1.0) -> Rig:
    """A rig file with a ripple in phase with the sine of the motor's angle."""
    if order == 1.0:
        return with_values(RIG, {"shaft_ripple_sin": TORQUE})
    return with_values(RIG, {"gear_ripple_sin": TORQUE, "gear_order": order})


def log_at(ahead: float, order: float, seed: int) -> Log:
    """A healthy move of a rig whose ripple is ahead by an angle as the log begins; drawn speed, direction and pitch."""
    rippling = effect("shaft_ripple", amplitude=TORQUE, order=order, phase=ahead)
    spec = replace(draw_move_case(seed, "nominal"), effects=(rippling,))
    return log_from_frame(make_log(spec, seed)[0])


@pytest.mark.parametrize(("order", "seed"), [(1.0, 64201), (1.0, 64202), (0.27, 64203), (3.4, 64204)])
@pytest.mark.parametrize("ahead", [0.3, 2.0, -1.7])
def test_a_ripple_is_found_where_it_stands_as_the_log_begins(order: float, seed: int, ahead: float) -> None:
    """Half a sample, by which a sampled servo may be later than its model, is 0.4 rad of the fastest of these ripples."""
    log = log_at(ahead, order, seed)
    found = phases_of(log, rippled(order), BankSettings())
    off = (found.shaft if order == 1.0 else found.gear) - ahead
    begun = order * 2.0 * math.pi * round(np.median(log.z[:5, 2]) / (2.0 * math.pi * RIG.model["D"]))
    assert abs(math.remainder(off + begun, 2.0 * math.pi)) < 0.5


@pytest.mark.slow
def test_a_healthy_move_of_another_phase_is_no_fault() -> None:
    """At the phase of the rig file the first of these moves is a jam, and the second a fault without a name."""
    logs = [log_at(ahead, 1.0, seed) for ahead, seed in ((2.0, 64211), (3.1, 64212), (-1.7, 64213))]
    verdicts = [diagnose_log(log, rippled(), Settings()).isolation for log in logs]
    assert [found.verdict.label for found in verdicts if found] == ["nominal"] * 3


def test_a_rig_without_ripples_and_a_log_without_motion_are_left_alone() -> None:
    log = log_at(1.0, 1.0, 64221)
    still = replace(log, w_cmd=np.zeros(log.t.size))
    for rig, given in ((RIG, log), (rippled(), still), (rippled(), None)):
        assert phases_of(given, rig, BankSettings()) == Phases()
        assert Phases().of(rig) is rig
    assert AsLogged(log, RIG, BankSettings()).rig is RIG


def test_a_phase_turns_the_ripple_and_keeps_its_size() -> None:
    model = Phases(shaft=0.5 * math.pi).of(rippled()).model
    assert model["shaft_ripple_sin"] == pytest.approx(0.0, abs=1e-12 * TORQUE)
    assert model["shaft_ripple_cos"] == pytest.approx(TORQUE)
    over_angle = with_values(RIG, {"curve_of": 1.0, "curve_over": 4.0, "curve_first": 0.0, "curve_step": 0.1})
    assert Phases(curve=0.2).of(over_angle).model["curve_first"] == pytest.approx(-0.2)
