"""Campaigns through filters: constants are those of the rig, and the filter is told. The truth is the independent one."""

import math
from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import RIG, log_of
from hidden.acquisition import ideal
from scipy.signal import butter, lfilter, lfilter_zi

from observer_fi.learn.contacts_and_losses import Breaks
from observer_fi.learn.gauss_newton import Free, Point
from observer_fi.learn.identification import TIMING, campaign_readings, identify
from observer_fi.learn.joint_likelihood import part_of
from observer_fi.learn.logger import low_passes
from observer_fi.learn.logger.filtered_readings import LATE, TIME, Through
from observer_fi.learn.logger.low_passes import FASTEST, LOOKED_AT, NOTICED_NATS, Tried, filter_of
from observer_fi.logs import log_from_frame
from observer_fi.records import Filter, Log

PROFILE = hidden.there_and_back((410.0, 300.0), (0.6, 0.6), (0.0, 8.0))
TRUE = hidden.TABLE_1


def behind(log: Log, channels: tuple[int, ...], hz: float, order: int) -> Log:
    b, a = butter(order, hz, fs=log.rate_hz)
    z = log.z.copy()
    for c in channels:
        z[:, c] = lfilter(b, a, z[:, c], zi=lfilter_zi(b, a) * z[0, c])[0]
    return replace(log, z=z)


# Before filters were told J came out 11 and 35 % too small behind 30 and 10 Hz, Rm 23 and 86 % too large.
@pytest.mark.slow
def test_constants_behind_a_filter_are_those_of_the_rig() -> None:
    has_the_constants((1,), 30.0, 1)


@pytest.mark.slow
@pytest.mark.parametrize("channels, hz, order", [((1,), 10.0, 2), ((1,), 100.0, 2), ((0, 1), 30.0, 2)])
@pytest.mark.first(1)
def test_so_they_are_behind_others(channels: tuple[int, ...], hz: float, order: int) -> None:
    has_the_constants(channels, hz, order)


def has_the_constants(channels: tuple[int, ...], hz: float, order: int) -> None:
    fit = identify([behind(log_of(PROFILE, seed=3), channels, hz, order)], RIG)
    names = [("voltage", "current", "position")[c] for c in channels]
    assert [(own.channel, own.order) for own in fit.filters] == [(name, order) for name in names]
    assert all(own.corner_hz == pytest.approx(hz, rel=0.03) for own in fit.filters)
    found = {p.name: p.value for p in fit.parameters}
    for name in ("J", "A", "Kp", "Ki", "Rm", "Km"):
        assert found[name] == pytest.approx(getattr(TRUE, name), rel=3e-3), name


@pytest.mark.slow
@pytest.mark.parametrize("cause", sorted(hidden.CAUSES)[::3])
@pytest.mark.first(1)
def test_no_cause_is_a_filter(cause: str) -> None:
    assert told_of(cause) == ()


def told_of(cause: str) -> tuple[Filter, ...]:
    """What is told of an actuator with a cause at thirty times its small size."""
    effects = (hidden.sized_effect(cause, 30.0),)
    return campaign_readings([log_of(PROFILE, seed=4, effects=effects)], RIG).low_passes.told


def test_a_filter_before_the_position_changes_no_constant() -> None:
    fit = identify([behind(log_of(PROFILE, seed=5), (2,), 30.0, 2)], RIG)
    assert fit.filters == ()
    found = {p.name: p.value for p in fit.parameters}
    for name in ("J", "A", "Kp", "Ki", "Rm", "Km"):
        assert found[name] == pytest.approx(getattr(TRUE, name), rel=3e-3), name


def test_nothing_is_looked_for_where_no_servo_tells() -> None:
    log = log_of(PROFILE, seed=6)
    log = replace(log, w_cmd=np.zeros(log.t.size))
    assert not campaign_readings([log], replace(RIG, drive="voltage")).low_passes.any


def late_current(seed: int, late_s: float, zero: tuple[float, float] = (0.0, 0.0)) -> Log:
    """A log whose current is so late, behind zero offsets of voltage and current."""
    spec = hidden.TruthSpec(PROFILE, TRUE)
    logger = ideal(spec.logger)
    for channel, offset, delay in (("voltage", zero[0], 0.0), ("current", zero[1], late_s)):
        logger.chains[channel] = replace(logger.chains[channel], offset=offset, delay_s=delay)
    return log_from_frame(hidden.make_log_through(logger, spec, seed)[0])


# Of multiples of the servo's tick: a current that it holds is as late as the tick in which it was set.
@pytest.mark.slow
@pytest.mark.parametrize(
    "seed, late_s, zero", [(7, 1.25e-4, (0.0, 0.0)), (8, 5e-4, (0.0, 0.0)), (9, 2.5e-4, (0.03, -2e-3))]
)
@pytest.mark.first(1)
def test_a_late_current_is_told_whatever_the_zeros(
    seed: int, late_s: float, zero: tuple[float, float]
) -> None:
    (own,) = campaign_readings([late_current(seed, late_s, zero)], RIG).low_passes.told
    assert own.channel == "current" and np.isinf(own.corner_hz)
    assert own.late == pytest.approx(late_s * 1600.0, abs=0.05)


# --- what is no filter ----------------------------------------------------------------------------

START = hidden.single_move(410.0, 0.4, pitch_deg=8.0)


def late(channels: tuple[str, ...], samples: float, seed: int, profile: hidden.Profile = START) -> Log:
    """Some channels read so much later, between the samples that a logger takes: the truth has every step of them.

    A current changes at the ticks of its servo, five in a sample: later within a tick is no later.
    """
    spec = hidden.TruthSpec(profile)
    acquisition = ideal(spec.logger)
    chains = dict(acquisition.chains)
    for name in channels:
        chains[name] = replace(chains[name], delay_s=samples / spec.logger.rate_hz)
    return log_from_frame(hidden.make_log_through(replace(acquisition, chains=chains), spec, seed)[0])


def found_in(log: Log) -> tuple[Through, dict[str, float]] | None:
    """The filter of a log whose rig is known but for what its readings say of it."""
    part = part_of(log, RIG, 0, Breaks(None, None, None))
    assert part is not None
    start = {name: RIG.model[name] for name in ("J", "A", "Kp", "Ki", "Rm", "Km", "Rs", "Vmax")}
    free = [*(Free(name, 1e-3 * value) for name, value in start.items()), *TIMING]
    return filter_of([part], RIG.model, free, {**start, "servo_delay": 6e-5, "input_delay": 0.0})


@pytest.mark.parametrize("offsets, seed", [((60e-3, -4e-3), 4), ((0.0, 6e-3), 5)])  # V, A
def test_zero_offsets_are_no_filter(offsets: tuple[float, float], seed: int) -> None:
    log = log_of(START, seed=seed)
    assert found_in(replace(log, z=log.z + [*offsets, 0.0])) is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.first(2)
def test_zero_offsets_hide_no_filter(seed: int) -> None:
    log = log_of(PROFILE, seed=seed)
    found = found_in(behind(replace(log, z=log.z + [0.0, 8e-3, 0.0]), (1,), 100.0, 2))
    assert found is not None and found[0] == Through((1,), 2)
    assert 1.0 / (2.0 * math.pi * found[1][TIME]) == pytest.approx(100.0, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "seed"), [(0.2, 0), (0.4, 1), (2.0, 2), (5.0, 0)])
@pytest.mark.first(1)
def test_constants_beside_a_late_current_are_those_of_the_rig(samples: float, seed: int) -> None:
    """A fifth of a sample makes Kp 1 % wrong."""
    fit = identify([late(("current",), samples, seed, PROFILE)], RIG)
    assert fit.filters == (Filter("current", math.inf, 1, pytest.approx(samples, abs=0.02)),)
    found = {p.name: p.value for p in fit.parameters}
    for name in ("J", "A", "Kp", "Ki", "Rm", "Km"):
        assert found[name] == pytest.approx(getattr(TRUE, name), rel=3e-3), name


@pytest.mark.parametrize(
    "channels",
    [("voltage", "current"), ("position",), pytest.param(("voltage",), marks=pytest.mark.slow)],
)
def test_what_else_is_late_is_a_cause_or_the_servo(channels: tuple[str, ...]) -> None:
    assert found_in(late(channels, 2.0, 3)) is None


NATS = 1e4  # that a fit without a filter is off
CURRENT_LATE, VOLTAGE_LATE, BOTH_LATE = ((Through(channels, 0), 1e-3) for channels in ((1,), (0,), (0, 1)))
FILTERED, FAST = (Through((1,), 1), 0.0), (Through((0,), 1), -1e-3)


@pytest.mark.parametrize(
    "costs, told",
    [
        ({CURRENT_LATE: 0.0}, CURRENT_LATE),
        ({VOLTAGE_LATE: 0.0}, None),
        ({BOTH_LATE: 0.0}, None),
        ({CURRENT_LATE: NATS - 0.9 * NOTICED_NATS}, None),
        ({CURRENT_LATE: NATS - 1.1 * NOTICED_NATS}, CURRENT_LATE),
        ({CURRENT_LATE: 1.1 * NOTICED_NATS, FILTERED: 0.0}, FILTERED),
        ({CURRENT_LATE: 0.9 * NOTICED_NATS, FILTERED: 0.0}, CURRENT_LATE),
        ({VOLTAGE_LATE: 0.9 * NOTICED_NATS, FILTERED: 0.0}, None),
        ({FILTERED: 0.0}, FILTERED),
        ({CURRENT_LATE: NOTICED_NATS, FAST: -NOTICED_NATS}, CURRENT_LATE),
        ({FAST: 0.0}, None),
    ],
)
def test_of_trials_the_simplest_that_is_clearly_better_is_told(
    costs: dict, told: tuple[Through, float] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """costs: nats of the trials that are better than no filter; each of them leaves the noise and nothing else.

    FAST is as fast as it may be, and early besides: an early voltage is as good as a late current.
    """

    class Trials:
        interval = 1.0
        is_none, is_dead = low_passes._Trial.is_none, low_passes._Trial.is_dead

        def __init__(self, *_: object) -> None:
            pass

        def tried(self, through: Through | None, samples: float) -> Tried:
            own = [(by, cost) for (other, by), cost in costs.items() if other == through]
            late_s, cost = own[0] if own else (0.0, NATS)
            left = np.full((1, 3), 1.0 if own else 10.0 * LOOKED_AT)
            values = {LATE: late_s, TIME: (0.9 if late_s < 0.0 else 1.1) * FASTEST}
            return Tried(through, Point(values, np.zeros((1, 2)), left, cost))

        def again(self, one: Tried, order: int) -> Tried:
            return self.tried(one.through and one.through._replace(order=order), 0.0)

    monkeypatch.setattr(low_passes, "_Trial", Trials)
    monkeypatch.setattr(low_passes, "_starts", list)
    found = filter_of([None], RIG.model, [], {})
    assert (found and (found[0], found[1][LATE])) == told


@pytest.mark.slow
def test_a_current_that_is_dead_is_behind_no_filter() -> None:
    """It had been taken out as one of 2.5 Hz, with all that the noise of such a sensor then becomes."""
    spec = hidden.draw_effect_case(130009, "current_gain", 50.0)
    assert hidden.right_size(spec.effects[0]).value == 0.0
    assert campaign_readings([log_from_frame(hidden.make_log(spec, 130009)[0])], RIG).low_passes.told == ()
