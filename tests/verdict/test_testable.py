"""Not tested: where a log holds nothing that could tell a fault, nothing is said about the actuator."""

import math
from dataclasses import replace

import numpy as np
import pytest

from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import Log, Outcome
from observer_fi.report import diagnosis as report
from observer_fi.settings import Settings
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.testable import FEWEST_MOVING, repeats_itself

RIG, SETTINGS = load_rig(), Settings()
MOVES = (Move(0.3, 410.0, 0.9),)


def made(
    kind: str = "none", rate: float = 1600.0, noise: float = 1.0, seed: int = 1, channel: str | None = None
) -> Log:
    fault = Fault() if kind == "none" else Fault(kind, 0.7, channel)
    return synthesise(Scenario(MOVES, 1.6, rate, fault=fault, noise=noise, seed=seed), RIG)[0]


def part(log: Log, first: int, last: int) -> Log:
    rows = slice(first, last)
    return replace(log, t=log.t[rows], z=log.z[rows], w_cmd=log.w_cmd[rows], pitch=log.pitch[rows])


def noise_log(seed: int, command: float) -> Log:
    rng = np.random.default_rng(seed)
    n = 3000
    return Log(
        "noise",
        np.arange(n) / 1600,
        rng.normal(size=(n, 3)) * (5.0, 0.1, 1e-3),
        command * rng.normal(size=n),
        np.zeros(n),
    )


def outcome_of(log: Log) -> Outcome:
    return diagnose_log(log, RIG, SETTINGS)


UNTESTED = {
    "rest": part(made(), 0, 470),
    "ten samples at rest": part(made(), 0, 10),
    "ten samples of a start": part(made(), 482, 492),
    "ten samples of a move": part(made(), 1000, 1010),
    "one less than needed": part(made(), 1000, 1000 + FEWEST_MOVING - 1),
    "noise": noise_log(0, 100.0),
    "small noise": noise_log(1, 1.0),
    "command at rest": noise_log(2, 0.0),
    "20 samples a second": made(rate=20.0),
}


@pytest.mark.parametrize("name", UNTESTED)
def test_nothing_is_said_about_the_actuator(name: str) -> None:
    outcome = outcome_of(UNTESTED[name])
    result = report.report_dict(outcome)
    verdict = result["verdict"]
    assert (verdict["label"], verdict["probability"], verdict["detected_s"]) == ("not_tested", None, None)
    assert set(result["posterior"].values()) == {0.0} and result["events"] == []
    assert result["open_loop"]["label"] == "not_tested"
    assert result["explanation"].startswith("Not tested: ")
    page = report.files(outcome, RIG)["report.html"]
    assert "Not tested" in page and "No fault" not in page and "behaved as" not in page
    assert report.headline(outcome).startswith("not tested: ")


def test_a_move_of_as_many_samples_as_needed_is_judged() -> None:
    assert outcome_of(part(made(), 1000, 1000 + FEWEST_MOVING)).isolation.verdict.label == "nominal"


@pytest.mark.parametrize("rate", [1600.0, 200.0, 50.0])
@pytest.mark.parametrize("kind", ["none", "overload", "coupling_loss"])
def test_readings_without_noise_are_judged_right(kind: str, rate: float) -> None:
    verdict = outcome_of(made(kind, rate, noise=0.0)).isolation.verdict
    assert verdict.label in ("nominal" if kind == "none" else kind, "not_tested")
    assert verdict.label != "not_tested" or rate < 75.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "kind, channel",
    [("none", None), ("overload", None), ("coupling_loss", None), ("sensor_frozen", "current")],
)
def test_fifty_samples_a_second_are_judged_right_or_not(kind: str, channel: str | None, seed: int) -> None:
    label = outcome_of(made(kind, 50.0, seed=seed, channel=channel)).isolation.verdict.label
    assert label in ({"none": "nominal", "sensor_frozen": "sensor_fault"}.get(kind, kind), "not_tested")


@pytest.mark.slow
def test_one_frozen_sensor_is_no_log_without_noise() -> None:
    """All channels repeating themselves say that nobody's readings are noisy; one says that it is frozen."""
    z = made().z[:20].copy()
    assert not repeats_itself(z, RIG, 0.02)
    z[:, 1] = z[0, 1]
    assert not repeats_itself(z, RIG, 0.02)
    z[:, 0] = z[0, 0]
    assert not repeats_itself(z, RIG, 0.02)
    z[:, 2] = np.nan  # not recorded
    assert repeats_itself(z, RIG, 0.02)
    z[:, 0] = np.nan
    assert not repeats_itself(z, RIG, 0.02)
    z[:] = 1.0
    assert repeats_itself(z, RIG, 0.02)
    assert not repeats_itself(z[:5], RIG, 0.02)
    frozen = made("sensor_frozen", channel="current")
    assert outcome_of(frozen).isolation.verdict.channel == "current"


def test_a_probability_that_is_none_is_no_number() -> None:
    verdict = outcome_of(UNTESTED["rest"]).isolation.verdict
    assert math.isnan(verdict.probability) and report.percent(verdict.probability) == "–"
    assert verdict == outcome_of(UNTESTED["ten samples at rest"]).isolation.verdict
