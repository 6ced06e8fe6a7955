"""Banks in lanes against the bank of one log, which has its own oracle."""

from dataclasses import replace

import numpy as np
import pytest
from moves import cut, holed, move, onset, rows

from observer_fi.bank import compiled_bank as kernels
from observer_fi.bank import lanes
from observer_fi.bank.hypotheses import Hypothesis, bank
from observer_fi.physics.rigs import load_rig, with_values
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import Log
from observer_fi.settings import BankSettings

RIG = load_rig()
SETTINGS = BankSettings(augment=False, unknown=False, sensors=False)
MOTION = ("w", "I", "x")
PLAIN = tuple(replace(h, states=MOTION) for h in bank(RIG, SETTINGS))


def assert_as_alone(
    got: lanes.Posterior, log: Log, hypotheses: tuple[Hypothesis, ...], atol: float = 1e-5
) -> None:
    """Equal but for rounding; where rounding decides whether a voltage is at its limit, two Jacobians differ for a while."""
    alone = kernels.Bank(RIG, SETTINGS, hypotheses).advance(log)
    np.testing.assert_array_equal(got.t, alone.t)
    np.testing.assert_allclose(got.probability, alone.probability, rtol=0.0, atol=atol)
    np.testing.assert_allclose(got.nis, alone.nis, rtol=1e-4, atol=1e-4)
    assert np.median(np.abs(got.probability - alone.probability)) < 1e-9
    assert np.median(np.abs(got.density - alone.density)) < 1e-8


def simulated(k: int) -> Log:
    """A move of the rig itself: filters that fit forget a rounding, those of another rig may carry it on."""
    fault = Fault(("none", "overload", "coupling_loss")[k % 3], 0.6)
    return synthesise(
        Scenario((Move(0.3, 410.0 * (-1) ** k, 1.0),), 1.0 + 0.1 * k, fault=fault, seed=k), RIG
    )[0]


def test_eleven_logs_of_different_lengths_are_as_each_alone() -> None:
    logs = [simulated(k) for k in range(11)]
    logs[4] = holed(logs[4], 4)
    logs[5] = rows(logs[5], (logs[5].t < 0.7) | (logs[5].t > 0.75))
    for log, got in zip(logs, lanes.posteriors(logs, [PLAIN] * 11, RIG, SETTINGS), strict=True):
        assert_as_alone(got, log, PLAIN)


def test_sets_of_parameters_on_one_log() -> None:
    log = cut(move(3, "overload"), 0.0, onset(3, "overload") + 0.2)
    banks = []
    for factor in (0.9, 0.95, 1.0, 1.1):
        rig = with_values(RIG, {"A": factor * RIG.model["A"], "J": RIG.model["J"] / factor})
        banks.append(tuple(replace(h, states=MOTION) for h in bank(rig, SETTINGS)))
    found = lanes.posteriors([log] * 4, banks, RIG, SETTINGS)
    for hypotheses, got in zip(banks, found, strict=True):
        assert_as_alone(got, log, hypotheses, atol=1e-4)  # filters that do not fit carry a rounding on
    assert len({round(float(got.density[:, 0].sum())) for got in found}) == 4


def test_other_states_and_missing_banks_are_errors() -> None:
    log = cut(move(3, "overload"), 0.0, 0.5)
    with pytest.raises(ValueError, match="states w, I, x"):
        lanes.posteriors([log], [bank(RIG, BankSettings())], RIG, BankSettings())
    with pytest.raises(ValueError, match="1 logs and 2 banks"):
        lanes.posteriors([log], [PLAIN] * 2, RIG, SETTINGS)
