"""Sums of normal equations against real fits, and what they say of constants."""

from dataclasses import replace

import numpy as np
import pytest

from observer_fi.learn import Free, fit, prepare
from observer_fi.physics import load_rig
from observer_fi.plan.evidence import (
    Fitted,
    library,
    logs_of,
    normals,
    precision,
    readings,
    std_of,
    weigh,
    whole,
)
from observer_fi.plan.limits import limits_of
from observer_fi.plan.moves import campaign, family, seconds_of
from observer_fi.plan.rivals import checked, no_cause, parse
from observer_fi.plan.sizes import rivals_of

RIG = load_rig()
LIMITS = limits_of(RIG)


@pytest.fixture(scope="module")
def rivals():
    return rivals_of(checked(parse("viscous_friction,torque_offset:torque_offset=3e-6")), RIG, LIMITS)


@pytest.mark.slow
def test_the_linear_look_is_what_a_fit_leaves(rivals):
    blocks = campaign(LIMITS) * 2
    exact = weigh(*whole(blocks, RIG, LIMITS), rivals, blocks[:1], [10.0])
    pair = next(p for p in exact.pairs if p.truth == "torque_offset")
    experiment, _ = whole(blocks, RIG, LIMITS)
    seen = replace(experiment, z=readings(experiment, rivals[1].forms[0]))
    other = rivals[0].forms[0]
    left = fit(seen, other.model, other.free, worth=1e-4).objective
    assert pair.left(np.ones(1)) == pytest.approx(left, rel=0.1)


@pytest.mark.slow
def test_a_profile_says_what_its_blocks_say(rivals):
    """What adds up of blocks simulated once is what the whole profile says, but for its first move."""
    blocks = [b for b in family(LIMITS) if b.words.startswith("from rest to 207")][:1] + list(
        campaign(LIMITS)[:1]
    )
    seconds = [seconds_of(b, LIMITS.accel) for b in blocks]
    apart = weigh(*library(blocks, RIG, LIMITS, blocks[0]), rivals, blocks, seconds)
    profile = tuple(blocks[:1] * 3 + blocks[1:] * 3)
    together = weigh(*whole(profile, RIG, LIMITS), rivals, blocks[:1], [10.0])
    assert apart.value(np.array([3.0, 3.0])) == pytest.approx(together.value(np.ones(1)), rel=0.25)


@pytest.mark.slow
def test_a_truth_fits_itself(rivals):
    experiment, owner = whole(campaign(LIMITS), RIG, LIMITS)
    for rival in rivals:
        (own,) = normals(experiment, owner, rival.forms[0], [readings(experiment, rival.forms[0])])
        assert own.left(np.ones(1)) < 1e-6


def test_standard_errors_are_those_of_a_fit():
    blocks = campaign(LIMITS)
    experiment, owner = whole(blocks, RIG, LIMITS)
    base = no_cause(RIG).forms[0]
    (own,) = normals(experiment, owner, base, [readings(experiment, base)])
    fitted = fit(prepare(logs_of(blocks, RIG, LIMITS, seed=3), RIG), base.model, base.free)
    white = np.sqrt(np.diag(fitted.covariance))
    names = [f.name for f in base.free]
    for name in ("J", "A", "Kp"):
        ratio = std_of(own, np.ones(1))[name] / white[names.index(name)]
        assert 0.4 < ratio < 1.1  # that of the fit is widened for what is correlated
    assert precision(own, np.array([2.0]), ["A", "J"]) > precision(own, np.ones(1), ["A", "J"])


def test_a_fit_keeps_its_bounds():
    """One parameter that may not go below 0 and is pulled there: nothing but the other one helps."""
    free = (Free("a", 1.0, 0.0), Free("b", 1.0, -1.0, 1.0))
    H, g = np.array([[[2.0, 0.0], [0.0, 2.0]]]), np.array([[-4.0, 10.0]])
    fitted = Fitted(free, np.zeros(2), H, g, np.array([60.0]))
    assert fitted.left(np.ones(1)) == pytest.approx(0.5 * (60.0 - 2 * 10.0 + 2.0))
