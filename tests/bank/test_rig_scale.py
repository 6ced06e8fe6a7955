"""The bank's numbers on rigs of other sizes."""

from dataclasses import replace

import numpy as np
import pytest

from observer_fi.bank.hypotheses import NO_NEWS, arrays, bank, repeat_share
from observer_fi.bank.rig_scale import PAPERS_HZ, between_samples, scale_of, usual_errors, with_servo_error
from observer_fi.physics import DataSheet, load_rig, rig_of_sheet, with_values
from observer_fi.records import Acquisition, ChannelTraits, Clock
from observer_fi.settings import BankSettings

SETTINGS = BankSettings()
SLIDE = rig_of_sheet(
    DataSheet(
        "slide",
        "voltage",
        lead=4e-3,
        resistance=2.3,
        torque_constant=0.052,
        rotor_inertia=5.2e-5,
        mass=6.0,
        supply=24.0,
    )
).rig


def test_the_papers_rig_has_the_papers_numbers() -> None:
    assert scale_of(load_rig().model) == pytest.approx((1.0, 1.0, 1.0, 1.0))


def test_what_a_larger_rig_may_do_is_larger() -> None:
    scale = scale_of(SLIDE.model)
    assert (
        scale.of("torque") > 50.0 and scale.current > 10.0 and scale.of("x") > 100.0 and scale.of("w") == 1.0
    )


def test_the_bank_enters_disturbances_of_the_rigs_size() -> None:
    hypotheses = bank(SLIDE, SETTINGS)
    unknown = next(k for k, h in enumerate(hypotheses) if h.name == "unknown")
    torque = hypotheses[unknown].states.index("torque")
    assert np.sqrt(arrays(hypotheses, SLIDE, SETTINGS).entry_var[unknown, torque]) > 0.5 * SLIDE.model["A"]


def test_a_guess_and_the_error_of_a_fit_widen_the_prior() -> None:
    def width(rig):  # of the inertia, of nominal
        nominal = bank(rig, SETTINGS)[0]
        return float(np.sqrt(arrays((nominal,), rig, SETTINGS).entry_var[0, nominal.states.index("J")]))

    paper = load_rig()
    assert width(paper) == pytest.approx(0.05)
    assert width(SLIDE) == pytest.approx(SLIDE.spread("J")) and SLIDE.spread("J") > 0.1
    J = paper.model["J"]
    assert width(with_values(paper, {"J": J}, {"J": 0.12 * J})) == pytest.approx(0.13)


@pytest.mark.parametrize("learned", [0.0, 0.1], ids=["", "healthy logs have shown less"])
@pytest.mark.parametrize("friction", [1.0, 30.0])
def test_an_integral_has_the_room_that_it_is_given(learned: float, friction: float) -> None:
    """Whatever a rig's file says of its servo's equation, and however large the rig is."""
    usual, rig = usual_errors(SETTINGS, load_rig()), load_rig()
    rig = replace(rig, errors={name: learned * value for name, value in usual.items()} if learned else {})
    rig = with_values(rig, {"A": friction * rig.model["A"]})
    assert usual_errors(with_servo_error(SETTINGS, rig, 0.7), rig)["servo"] == pytest.approx(0.7)


def test_slow_samples_of_an_unknown_servo_leave_its_speed_in_doubt() -> None:
    assert between_samples(SETTINGS, SLIDE, PAPERS_HZ / 4.0).agility == pytest.approx(4.0 * SETTINGS.agility)
    assert between_samples(SETTINGS, SLIDE, 5000.0) is SETTINGS
    for rate_hz in (100.0, 250.0):  # at 250 Hz a servo whose torque is fed forward steps between two samples
        slow = between_samples(SETTINGS, SLIDE, rate_hz)
        assert (slow.meanwhile, slow.repeat_weight, slow.agility) == (1.0, 0.0, SETTINGS.agility)
    assert between_samples(SETTINGS, load_rig(), 100.0) is SETTINGS


OF_THE_PAPER = (10e-3, 0.3e-3, 10e-6)  # V, A, m: noise of the readings


def coarse(rig, sigmas, fine=(), repeats=0.4):
    """The rig through a logger whose readings repeat themselves at rest, in steps but for the channels `fine`."""
    channels = (
        ChannelTraits(s, s, None if name in fine else 0.9 * s, repeats=repeats, neighbour_std=s)
        for name, s in zip(("voltage", "current", "position"), sigmas, strict=True)
    )
    return replace(rig, logger=Acquisition(*channels, Clock(0.0, None, 1e-3)))


def test_a_reading_that_an_unknown_servo_holds_still_is_no_frozen_sensor() -> None:
    """One that repeats itself at rest says nothing by that, and neither does a current beside no voltage."""
    unknown = load_rig().without_servo
    voltage, current, position = repeat_share(coarse(unknown, OF_THE_PAPER), SETTINGS)
    assert voltage == current == NO_NEWS and position == 1.0
    known = repeat_share(coarse(load_rig(), OF_THE_PAPER), SETTINGS)
    assert (known <= 1.0).all()
    told = repeat_share(unknown, SETTINGS)
    assert (told < 1.0).all()
    alone = repeat_share(replace(SLIDE, drive="current"), SETTINGS)
    assert alone[1] == NO_NEWS


@pytest.mark.parametrize("repeats", [0.0, 0.05])
def test_a_reading_that_seldom_repeats_itself_at_rest_is_news_where_it_does(repeats: float) -> None:
    share = repeat_share(
        coarse(load_rig().without_servo, OF_THE_PAPER, ("voltage", "current"), repeats), SETTINGS
    )
    assert (share[:2] < 1.0).all()
