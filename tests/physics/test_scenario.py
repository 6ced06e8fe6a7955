"""Synthetic logs: what was asked for is what is in them, and a seed repeats them."""

import gzip
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from observer_fi.errors import UsageError
from observer_fi.logs.ingest import read_log
from observer_fi.physics.faults import FAULT_KINDS, FAULTS
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import (
    Fault,
    Move,
    Scenario,
    csv_bytes,
    drawn_scenario,
    synthesise,
    trapezoids,
)

RIG = load_rig()
SENSOR_FAULTS = [kind for kind, row in FAULT_KINDS.items() if row.by_channel]


def test_a_seed_repeats_the_log_and_another_does_not() -> None:
    a, b, c = (synthesise(Scenario(spread=True, seed=s), RIG)[0].z for s in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert not np.allclose(a, c)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_before_the_fault_nothing_differs(kind: str) -> None:
    """Every kind changes something from its time on, and nothing before."""
    channel = "position" if FAULT_KINDS[kind].by_channel else None
    healthy = synthesise(Scenario(), RIG)[0]
    log, _ = synthesise(Scenario(fault=Fault(kind, 1.00037, channel)), RIG)
    before = log.t < 1.00037
    np.testing.assert_allclose(log.z[before], healthy.z[before], rtol=0, atol=1e-9)
    if kind != "none":
        after = np.nan_to_num(np.abs(log.z - healthy.z)[~before] / RIG.noise_std, nan=99.0)
        assert after.max() > 9.0  # standard deviations: none of 12 000 samples of noise


@pytest.mark.parametrize(
    ("label", "kinds"),
    [
        ("nominal", ["none"]),
        ("overload", ["overload"]),
        ("coupling_loss", ["coupling_loss"]),
        ("sensor_fault", SENSOR_FAULTS),
        ("slip", ["slip"]),
        ("jam", ["friction"]),
        ("unknown", ["winding", "supply"]),
    ],
)
def test_the_truth_names_the_verdict_that_is_right(label: str, kinds: Sequence[str]) -> None:
    for kind in kinds:
        channel = "current" if label == "sensor_fault" else None
        _, truth = synthesise(Scenario(seconds=1.2, fault=Fault(kind, 1.00037, channel)), RIG)
        assert (truth.label, truth.channel) == (label, channel)
        assert truth.onset_s == (None if kind == "none" else 1.00037)


@pytest.mark.parametrize("at_s", [0.0, 0.3, 1.0, 1.00031, 3.1999])
@pytest.mark.parametrize("kind", ["overload", "coupling_loss", *FAULTS["unknown"].made_by])
def test_a_fault_may_fall_anywhere(kind: str, at_s: float) -> None:
    """At rest, on a sample, between two, after the last: the log is whole and finite."""
    log, truth = synthesise(Scenario(fault=Fault(kind, at_s)), RIG)
    assert log.z.shape == (round(3.2 * 1600), 3)
    assert np.isfinite(log.z).all()
    assert truth.onset_s == at_s


def test_overload_and_coupling_loss_do_what_the_paper_says() -> None:
    pressed = synthesise(Scenario(fault=Fault("overload", 1.0), noise=0.0), RIG)[0]
    loose = synthesise(Scenario(fault=Fault("coupling_loss", 1.0), noise=0.0), RIG)[0]
    at = np.searchsorted(pressed.t, [0.9, 1.1, 2.0, 2.5])
    speed = np.diff(pressed.z[at, 2]) / np.diff(pressed.t[at])
    assert speed[2] == pytest.approx(1.9e-6 * 410.0 * (1.0 - 0.52), rel=0.01)  # equation 10
    assert pressed.z[at[3], 1] > pressed.z[at[1], 1]
    assert loose.z[at[1], 2] == loose.z[at[3], 2]
    assert loose.z[at[3], 1] == pytest.approx(3.4e-4 / 0.0212, rel=1e-3)  # A'/Km, equation 13


@pytest.mark.parametrize("speed", [300.0, -300.0])
def test_an_overload_at_rest_stands_in_the_way_of_the_next_move(speed: float) -> None:
    log = synthesise(Scenario((Move(0.3, speed, 2.5),), fault=Fault("overload", 0.1), noise=0.0), RIG)[0]
    travelled = abs(log.z[np.searchsorted(log.t, 2.0), 2])
    assert travelled == pytest.approx(1.9e-6 * 300.0 * 1.7 * 0.48, rel=0.02)


def test_moves_that_touch_reverse_without_a_stop() -> None:
    t, w = trapezoids((Move(0.1, 400.0, 1.0), Move(1.1, -400.0, 1.0)), 6e4, 3.0)
    assert np.interp(1.1 + 800.0 / 6e4, t, w) == pytest.approx(-400.0)
    assert np.interp([0.05, 0.6, 1.6, 2.5], t, w) == pytest.approx([0.0, 400.0, -400.0, 0.0])


@pytest.mark.parametrize(
    "scenario",
    [
        Scenario(fault=Fault("overlaod", 1.0)),
        Scenario(fault=Fault("sensor_frozen", 1.0)),
        Scenario(fault=Fault("sensor_frozen", 1.0, "speed")),
        Scenario(fault=Fault("overload", 1.0, "position")),
        Scenario(fault=Fault("overload", 9.0)),
        Scenario((Move(0.3, 410.0, 2.0), Move(1.0, 410.0, 1.0))),
        Scenario((Move(0.3, 410.0, 0.001),)),
        Scenario(effects={"viscosity": 1.0}),
    ],
)
def test_a_scenario_that_cannot_be_is_refused(scenario: Scenario) -> None:
    with pytest.raises(UsageError):
        synthesise(scenario, RIG)


def test_the_csv_reads_back(tmp_path: Path) -> None:
    log, _ = synthesise(Scenario(fault=Fault("sensor_dropout", 1.0, "current"), pitch_deg=2.0, seed=4), RIG)
    path = tmp_path / "log.csv.gz"
    path.write_bytes(csv_bytes(log, compress=True))
    assert gzip.decompress(path.read_bytes()) == csv_bytes(log)
    back = read_log(path)
    np.testing.assert_allclose(back.t, log.t, atol=1e-6)
    np.testing.assert_allclose(back.z, log.z, atol=6e-5)
    np.testing.assert_allclose(back.z[:, 2], log.z[:, 2], atol=1e-7)
    np.testing.assert_allclose(back.w_cmd, log.w_cmd, atol=1e-3)
    assert back.metadata == ("synthetic, seed 4",)


def test_the_monte_carlo_stays_in_its_ranges() -> None:
    for k in range(30):
        s = drawn_scenario(np.random.default_rng(k), "overload", k % 2 == 0, k)
        move = s.moves[0]
        assert 205.0 <= abs(move.speed) <= 410.0 and -12.0 <= s.pitch_deg <= 12.0
        after = s.fault.at_s - move.start_s
        assert (after < 0.25) == (k % 2 == 0) and 0.0 < after < move.seconds - 0.5


def test_an_offset_of_the_voltage_is_there_once() -> None:
    plain, offset = (
        synthesise(Scenario(effects=e, noise=0.0), RIG)[0] for e in ({}, {"voltage_offset": 0.02})
    )
    np.testing.assert_allclose(offset.z[:, 0] - plain.z[:, 0], 0.02, rtol=0, atol=1e-9)
    np.testing.assert_allclose(offset.z[:, 1:], plain.z[:, 1:], rtol=0, atol=1e-12)
