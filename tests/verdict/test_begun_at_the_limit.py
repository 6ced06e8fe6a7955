"""A log that begins within a start begins for the filters where voltage and current tell what the servo asks for."""

from dataclasses import replace

import hidden
import numpy as np
import pytest

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.logger.begun_at_the_limit import LONGEST_S, known_from

RIG = load_rig()
SUPPLY = RIG.model["Vmax"]


def log_of(volts: np.ndarray, command: float = 410.0, rate: float = 1000.0) -> Log:
    z = np.column_stack((volts, np.full(volts.size, 1e-3), np.zeros(volts.size)))
    t = np.arange(volts.size) / rate
    return Log("begun", t, z, np.full(volts.size, command), np.zeros(volts.size))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_at_the_limit_is_left_out(sign: float) -> None:
    volts = np.full(400, 0.6 * SUPPLY)
    volts[:37] = SUPPLY
    assert known_from(log_of(sign * volts, sign * 410.0), RIG) == 37
    assert known_from(log_of(sign * volts[37:], sign * 410.0), RIG) == 0


def test_a_log_that_begins_at_rest_begins_there() -> None:
    assert known_from(log_of(np.full(400, SUPPLY), 0.0), RIG) == 0


def test_a_motor_that_runs_at_the_limit_is_taken_as_it_is() -> None:
    assert known_from(log_of(np.full(round(3e3 * LONGEST_S), SUPPLY)), RIG) == 0


@pytest.mark.parametrize("begin_s", [0.01, 0.02, 0.03, 0.045, 0.06, 0.1])
@pytest.mark.first(3)
def test_a_campaign_that_begins_within_a_start_is_healthy(begin_s: float) -> None:
    """Its filters had taken the unknown integral for half the inertia, and gave up in the seventh move."""
    for seed in (8200, 8201):
        spec = hidden.draw_effects_case(seed, (), 0.0)
        profile = hidden.there_and_back((410.0, 200.0), (0.4, 0.4), (0.0, 5.0))
        log = log_from_frame(hidden.make_log(replace(spec, profile=profile), seed)[0])
        begun = log.part(slice(int(np.searchsorted(log.t, profile.moves[0].start_s + begin_s)), None))
        outcome = diagnose_log(begun, RIG, Settings())
        isolation = outcome.isolation
        assert {event.label for event in isolation.events} == {"nominal"}, seed
        assert isolation.consistency.nis_mean < 1.5 * isolation.consistency.nis_expected
        left_out = known_from(begun, RIG)
        said = [words for words in outcome.warnings if "begins within a start" in words]
        assert len(said) == bool(left_out) and outcome.samples == begun.t.size - left_out
