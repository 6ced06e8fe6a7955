"""A motor's encoder, where one is logged, says whether the mass or the circuit is right about how far it turned."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import hidden
import numpy as np
import pytest
from campaigns import RIG

from observer_fi.logs import log_from_frame
from observer_fi.records import Array, Event, Log, Outcome
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log
from observer_fi.verdict.moves.by_encoder import by_the_encoder


class Case(NamedTuple):
    """A move of a rig of the paper's spread with a fault; with a channel, its gain is what fails, to this size."""

    seed: int
    kind: str
    channel: str = ""
    gain: float = 0.0
    encoder: bool = True


@cache
def judged(case: Case) -> tuple[Log, Outcome]:
    spec = hidden.draw_severity_case(case.seed, case.kind)
    if case.channel:
        fault = hidden.Fault("sensor_fault", spec.fault.onset_s, "gain", case.channel, case.gain)
        spec = replace(spec, fault=fault)
    spec = replace(spec, logger=replace(spec.logger, log_encoder=case.encoder))
    log = log_from_frame(hidden.make_log(spec, case.seed)[0])
    return log, diagnose_log(log, RIG, Settings())


def said(case: Case, label: str, **more: object) -> Outcome:
    """The outcome of a log as if the bank had called its one fault so."""
    found = judged(case)[1].isolation
    assert found is not None
    verdict = found.verdict._replace(
        **{"label": label, "channel": None, "probability": 1.0, "alike": (), **more}
    )
    return replace(judged(case)[1], isolation=replace(found, verdict=verdict, events=(verdict,)))


def then(case: Case, label: str, encoder: Array | None = None, **more: object) -> Event:
    log = judged(case)[0]
    log = log if encoder is None else replace(log, encoder=encoder)
    found = by_the_encoder(said(case, label, **more), lambda: log, RIG).isolation
    assert found is not None
    return found.verdict


@pytest.mark.slow
@pytest.mark.parametrize("label", ["slip", "coupling_loss", "overload"])
@pytest.mark.parametrize("gain", [1.2, 0.6])
@pytest.mark.parametrize("seed", [872001, 872002])
@pytest.mark.first(2)
def test_an_encoder_that_goes_with_the_mass_refutes_that_it_slips(label: str, gain: float, seed: int) -> None:
    told = then(Case(seed, "jam", "voltage", gain), label)
    assert (told.label, told.channel, told.alike) == ("sensor_fault", "voltage", ())
    assert told.probability >= 0.95
    assert "encoder_rad goes with position_m" in told.reasons[0]
    assert told.severity == ()


@pytest.mark.parametrize("label", ["slip", "coupling_loss"])
@pytest.mark.parametrize("gain", [4.0, -3.0])
@pytest.mark.parametrize("seed", [872001, 872002])
@pytest.mark.first(3, 6)
def test_nor_is_it_a_voltage_that_lies_where_a_current_does(label: str, gain: float, seed: int) -> None:
    """Of the paper's motor a current takes little of the voltage: its gain must be gross to say how far the mass went."""
    told = then(Case(seed, "jam", "current", gain), label)
    assert (told.label, told.channel) == ("sensor_fault", "current")


@pytest.mark.slow
@pytest.mark.parametrize("label", ["slip", "coupling_loss"])
@pytest.mark.parametrize("seed", [872003, 872004])
@pytest.mark.first(1)
def test_one_that_goes_with_the_circuit_lets_it_slip(label: str, seed: int) -> None:
    case = Case(seed, label)
    assert then(case, label).label == label
    either = then(case, "sensor_fault", channel="voltage", alike=(label,), probability=0.5)
    assert (either.label, either.channel, either.alike) == (label, None, ())


def test_a_position_that_reads_more_is_no_liar_of_the_circuit() -> None:
    case = Case(872005, "jam", "position", 1.2)
    assert then(case, "slip").label == "slip"
    assert then(case, "sensor_fault", channel="position").channel == "position"


@pytest.mark.slow
def test_without_an_encoder_nothing_changes() -> None:
    case = Case(872006, "jam", "voltage", 1.2, encoder=False)
    outcome = said(case, "slip")
    assert by_the_encoder(outcome, lambda: judged(case)[0], RIG) is outcome


@pytest.mark.parametrize("scale", [0.0, 180.0 / np.pi, -1.0, np.nan])
@pytest.mark.parametrize("label", ["slip", "coupling_loss"])
@pytest.mark.first(1, 4)
def test_an_encoder_that_is_dead_or_counts_otherwise_refutes_nothing(label: str, scale: float) -> None:
    """A mass that stops beside an encoder that stands seemed to go with it."""
    case = Case(872003, label)
    encoder = judged(case)[0].encoder
    assert encoder is not None
    assert then(case, label, scale * encoder).label == label


def test_readings_of_an_encoder_that_are_missing_are_in_between() -> None:
    case = Case(872001, "jam", "voltage", 1.2)
    encoder = judged(case)[0].encoder
    assert encoder is not None
    holes = encoder.copy()
    holes[::7] = np.nan
    assert then(case, "slip", holes).channel == "voltage"


@pytest.mark.parametrize("edges", [50, 10_000])
def test_coarse_and_fine_encoders_say_the_same(edges: int) -> None:
    case = Case(872007, "jam", "voltage", 1.3)
    encoder, step = judged(case)[0].encoder, 2.0 * np.pi / edges
    assert encoder is not None
    told = then(case, "slip", np.floor(encoder / step) * step)
    assert (told.label, told.channel) == ("sensor_fault", "voltage")
