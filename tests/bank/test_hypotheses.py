"""The hypotheses of a bank: which states they share, how they are entered, and how often a mode changes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from observer_fi.bank import transition as tr
from observer_fi.bank.hypotheses import (
    Hypothesis,
    arrays,
    bank,
    of_a_move,
    on_top,
    repeat_share,
    transition_rates,
)
from observer_fi.bank.packing import bank_rows, find_places
from observer_fi.physics.equations import INDEX
from observer_fi.physics.faults import FAULTS
from observer_fi.physics.rigs import Rig, load_rig
from observer_fi.records import Acquisition, ChannelTraits, Clock
from observer_fi.settings import BankSettings

RIG = load_rig()
SETTINGS = BankSettings()
HYPOTHESES = bank(RIG, SETTINGS)
ARRAYS = arrays(HYPOTHESES, RIG, SETTINGS)
NAMES = tuple(h.name for h in HYPOTHESES)


def test_the_default_bank() -> None:
    sensors = ("sensor:voltage", "sensor:current", "sensor:position")
    assert list(NAMES) == ["nominal", "overload", "coupling_loss", "unknown", *sensors]
    assert [h.failed for h in HYPOTHESES] == [-1, -1, -1, -1, 0, 1, 2]
    assert {h.label for h in HYPOTHESES[4:]} == {"sensor_fault"}
    assert all(h.states[:3] == ("w", "I", "x") for h in HYPOTHESES)
    assert "d" in HYPOTHESES[1].states and "A_decoupled" in HYPOTHESES[2].states
    assert {"torque", "rate"} <= set(HYPOTHESES[3].states)


@pytest.mark.parametrize(("switches", "names"), [
    ({"unknown": False, "sensors": False}, NAMES[:3]),
    ({"sensors": False}, NAMES[:4]),
    ({"unknown": False}, (*NAMES[:3], *NAMES[4:])),
])  # fmt: skip
def test_parts_of_the_bank_can_be_left_out(switches: dict[str, bool], names: tuple[str, ...]) -> None:
    assert tuple(h.name for h in bank(RIG, BankSettings(**switches))) == names


def test_without_augmentation_only_the_motion_is_estimated() -> None:
    plain = bank(RIG, BankSettings(augment=False, unknown=False, sensors=False))
    assert [h.states for h in plain] == [("w", "I", "x"), ("w", "I", "x", "d"), ("w", "I", "x")]


def test_source_maps_follow_state_names() -> None:
    """State k of j comes from the state of the same name in i, wherever that stands, or from nowhere."""
    for j, target in enumerate(HYPOTHESES):
        for i, source in enumerate(HYPOTHESES):
            for k, state in enumerate(target.states):
                at = ARRAYS.source[j, i, k]
                assert at == (source.states.index(state) if state in source.states else -1)
            assert (ARRAYS.source[j, i, len(target.states) :] == -1).all()


def test_states_that_several_hypotheses_have_stand_in_one_place() -> None:
    """Those of one alone share the places behind, and a place holds the prior of whoever has it."""
    found, common = find_places(HYPOTHESES)
    at = [dict(zip(h.states, to, strict=True)) for h, to in zip(HYPOTHESES, found, strict=True)]
    for j, h in enumerate(HYPOTHESES):
        assert len(set(found[j])) == len(h.states)
        for state in h.states:
            others = [k for k, other in enumerate(HYPOTHESES) if state in other.states]
            assert len({at[k][state] for k in others}) == 1
            assert (at[j][state] < common) == (len(others) > 1)
    rows = bank_rows(HYPOTHESES, ARRAYS)
    assert at[1]["d"] == at[2]["A_decoupled"] == at[3]["torque"] == common and rows.n == common + 3
    for j, h in enumerate(HYPOTHESES):
        absent = np.setdiff1d(np.arange(rows.n), found[j])
        np.testing.assert_array_equal(rows.holds[:, j], np.isin(np.arange(rows.n), found[j]))
        np.testing.assert_array_equal(rows.entry_mean[found[j], j], ARRAYS.entry_mean[j, : len(h.states)])
        np.testing.assert_array_equal(rows.entry_var[found[j], j], ARRAYS.entry_var[j, : len(h.states)])
        assert not rows.entry_var[absent, j].any() and not rows.diffusion[absent, j].any()
    np.testing.assert_array_equal(
        rows.holds[:, 7], rows.holds[:, 0]
    )  # a row without a hypothesis repeats the first


def test_entry_priors_are_the_rigs_spread() -> None:
    for j, h in enumerate(HYPOTHESES):
        for k, state in enumerate(h.states):
            mean, std = ARRAYS.entry_mean[j, k], np.sqrt(ARRAYS.entry_var[j, k])
            own = {s.name: s.std for s in FAULTS[h.label].states if s.std is not None}
            if state in SETTINGS.entry_std | own:
                assert (mean, std) == (0.0, pytest.approx((SETTINGS.entry_std | own)[state]))
            else:
                assert mean == 1.0
                assert std == pytest.approx(SETTINGS.doubt.get(state) or RIG.spread(state))
        assert ARRAYS.size[j] == len(h.states)
    assert (ARRAYS.entry_var > 0.0).all()


def test_own_constants_are_those_that_nominal_lacks() -> None:
    own = {h.name: {s for k, s in enumerate(h.states) if ARRAYS.own[j, k]} for j, h in enumerate(HYPOTHESES)}
    assert own["overload"] == {"C", "E"} and own["coupling_loss"] == {"A_decoupled"}
    assert not any(own[name] for name in NAMES if name not in ("overload", "coupling_loss"))


def test_state_codes_and_layout_agree() -> None:
    for j, h in enumerate(HYPOTHESES):
        kinds = h.kinds
        for state, kind in zip(h.states, kinds, strict=True):
            if state in INDEX:
                assert kind == tr.SCALE + INDEX[state]
        row = ARRAYS.layout[j]
        assert ARRAYS.size[j] == len(h.states)
        for slot, state in (
            (tr.AT_D, "d"),
            (tr.AT_A, "A"),
            (tr.AT_J, "J"),
            (tr.AT_C, "C"),
            (tr.AT_SUPPLY, "Vmax"),
        ):
            assert row[slot] == (h.states.index(state) if state in h.states else -1)


# --- the mode process ----------------------------------------------------------------------------


@given(
    fault=st.floats(1e-6, 10.0), recovery=st.floats(1e-6, 10.0), between=st.floats(0.0, 1.0), rare=st.floats(0.0, 1.0)
)  # fmt: skip
def test_rates_are_a_generator(fault: float, recovery: float, between: float, rare: float) -> None:
    settings = BankSettings(fault_rate=fault, recovery_rate=recovery, between_rate=between, rare=rare)
    Q = transition_rates(HYPOTHESES, settings)
    np.testing.assert_allclose(Q.sum(axis=1), 0.0, atol=1e-12 * np.abs(Q).max())
    assert (Q[~np.eye(len(Q), dtype=bool)] >= 0.0).all()
    assert Q[0, 1] == Q[0, 2] == fault and Q[0, 3] == fault * rare
    assert (
        Q[1, 0] == recovery and (Q[2:, 0] == 0.0).all()
    )  # the mass can leave an obstacle; nothing else heals


@pytest.mark.parametrize("dt", [1e-5, 1 / 1600, 1 / 400, 1.0, 1000.0])
def test_transition_matrix_is_the_exponential(dt: float) -> None:
    M, work = np.empty((7, 7)), np.empty((2, 7, 7))
    Q = transition_rates(HYPOTHESES, BankSettings(fault_rate=0.3, recovery_rate=0.2, between_rate=0.1))
    tr.mode_transition(Q, dt, M, work)
    np.testing.assert_allclose(M, expm(Q * dt), atol=1e-13 * max(1.0, dt))
    np.testing.assert_allclose(M.sum(axis=1), 1.0, atol=1e-13 * max(1.0, dt))


def test_between_two_moves_a_fault_may_be_mended() -> None:
    M, work, out = np.empty((7, 7)), np.empty((2, 7, 7)), np.empty((7, 7))
    tr.mode_transition(ARRAYS.rates, 1 / 1600, M, work)
    tr.renewed(M, 0.01, out)
    np.testing.assert_allclose(out.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_array_equal(out[0], M[0])
    assert (out[1:, 0] >= 0.01).all() and (out[1:, 0] < 0.0101).all()


def test_rates_are_per_second_whatever_the_sampling() -> None:
    """Four steps at 1600 Hz are one at 400 Hz."""
    fine, coarse, work = np.empty((7, 7)), np.empty((7, 7)), np.empty((2, 7, 7))
    tr.mode_transition(ARRAYS.rates, 1 / 1600, fine, work)
    tr.mode_transition(ARRAYS.rates, 1 / 400, coarse, work)
    np.testing.assert_allclose(np.linalg.matrix_power(fine, 4), coarse, rtol=1e-12)


# --- readings that repeat themselves ----------------------------------------------------------------


def logged(**fields: object) -> Rig:
    channels = [ChannelTraits(std, std)._replace(**fields) for std in RIG.file_noise_std.tolist()]
    return replace(RIG, logger=Acquisition(*channels, Clock(0.0, None, 1.0 / 1600.0)))


def test_a_repeat_is_one_within_a_share_of_the_noise() -> None:
    usual = SETTINGS.repeat_scale
    np.testing.assert_allclose(repeat_share(RIG, SETTINGS), usual)
    np.testing.assert_allclose(repeat_share(logged(), SETTINGS), usual)


def test_hum_does_not_make_a_repeat_of_what_the_noise_changes() -> None:
    """Four times the noise by hum, neighbours as before: the same readings repeat themselves."""
    loud = logged(as_white=1.0)
    np.testing.assert_allclose(
        repeat_share(loud, SETTINGS) * loud.noise_std, SETTINGS.repeat_scale * RIG.noise_std
    )


def test_coarse_readings_repeat_themselves_within_their_step() -> None:
    coarse = logged(resolution=1e-3)
    np.testing.assert_allclose((repeat_share(coarse, SETTINGS) * coarse.noise_std)[1:], 0.4e-3)


def test_where_readings_repeat_themselves_at_rest_a_repeat_says_nothing() -> None:
    np.testing.assert_array_equal(repeat_share(logged(repeats=0.5), SETTINGS), 1.0)
    np.testing.assert_allclose(repeat_share(logged(repeats=0.01), SETTINGS), SETTINGS.repeat_scale)


@pytest.mark.parametrize("chance", [0.03, 0.06, 0.09])
def test_readings_that_repeat_themselves_by_chance_gain_what_that_is_worth(chance: float) -> None:
    """Of white noise in steps; five in a row had been a frozen sensor."""
    share = repeat_share(logged(repeats=chance), SETTINGS)
    step = chance * 2.0 * np.sqrt(np.pi)  # of the noise: two readings of it within one step
    noise = np.random.default_rng(1).standard_normal(200_000)
    read = step * np.round(noise / step)
    again = np.diff(read) == 0.0
    assert again.mean() == pytest.approx(chance, rel=0.05)
    frozen = (
        again / share[1]
    )  # densities over those of the noise, which is near its mean where it repeats itself
    healthy = np.exp(-0.5 * read[1:] ** 2)
    assert np.mean(again) * np.log(1.0 / chance) == pytest.approx(
        np.sum(np.log(frozen[again] / healthy[again])) / again.size, rel=0.15
    )


def test_a_fault_on_top_of_another_one_keeps_what_that_left_behind() -> None:
    by_name: dict[str, Hypothesis] = {h.name: h for h in reversed(of_a_move(RIG, SETTINGS))}
    slip, jam = by_name["slip"], by_name["jam"]
    both = on_top(slip, jam)
    assert both.label == "jam" and both.own == jam.own
    assert set(both.states) == {*slip.states, "torque"}
    assert (both.model["contact"], both.model["C"]) == (1.0, 0.0) and both.model["E"] == slip.model["E"]
    rows = arrays((both,), RIG, SETTINGS)
    assert rows.diffusion[0, both.states.index("E")] > 0.0  # it may go on to grow
    gone, same = by_name["coupling_loss"], by_name["overload"]
    assert on_top(slip, gone) is gone  # the motor turns without the mass
    assert on_top(slip, same) is same  # the share lost is one constant
    assert on_top(HYPOTHESES[0], jam) is jam


def test_a_sensor_that_is_not_there_does_not_fail() -> None:
    voltage = next(j for j, h in enumerate(HYPOTHESES) if h.name == "sensor:voltage")
    usual, without = (
        transition_rates(HYPOTHESES, BankSettings()),
        transition_rates(HYPOTHESES, BankSettings(), (0,)),
    )
    assert (
        usual[0, voltage] > 0.0
        and (without[:, voltage][without[:, voltage] > 0.0] < 1e-9 * usual[0, voltage]).all()
    )
    np.testing.assert_allclose(without.sum(axis=1), 0.0, atol=1e-12)
    others = [j for j in range(1, len(HYPOTHESES)) if j != voltage]
    np.testing.assert_array_equal(without[0, others], usual[0, others])


@pytest.mark.parametrize("shown", [True, False])
def test_a_sensor_that_is_not_logged_does_not_fail(shown: bool) -> None:
    """Nothing tells its failure from health, and what is the winner once stays it."""
    noise = 0.01 if shown else math.nan
    traits = [ChannelTraits(own, own) for own in (noise, 3e-4, 1e-5)]
    logged = replace(RIG, logger=Acquisition(*traits, Clock(0.0, None, 6.25e-4)))
    of_voltage = [h.name for h in HYPOTHESES].index("sensor:voltage")
    rate = arrays(HYPOTHESES, logged, BankSettings()).rates[0, of_voltage]
    usual = arrays(HYPOTHESES, RIG, BankSettings()).rates[0, of_voltage]
    assert rate == (usual if shown else pytest.approx(0.0, abs=1e-9 * usual))


@pytest.mark.parametrize("repeats", [0.0, 0.02, 0.05, 0.2])
@pytest.mark.parametrize("times", [1.0, 4.0, 14.0])
def test_a_repeat_never_gains_more_than_chance_allows(repeats: float, times: float) -> None:
    """Of white noise, and of noise that wanders, taken for white noise that is so many times what neighbours differ by."""
    stds = RIG.file_noise_std.tolist()
    channels = [ChannelTraits(std, times * std, neighbour_std=std, repeats=repeats) for std in stds]
    rig = replace(RIG, logger=Acquisition(*channels, Clock(0.0, None, 1.0 / 1600.0)))
    share = np.minimum(repeat_share(rig, SETTINGS), 1.0)
    assert repeats == 0.0 or (-np.log(share) <= -np.log(repeats) + 1e-9).all()
    if repeats == 0.0:
        np.testing.assert_allclose(
            share, SETTINGS.repeat_scale / times
        )  # one that stands is told all the same


def test_readings_without_noise_say_nothing_strange() -> None:
    """No warning of arithmetic on zeros, whatever repeats itself."""
    for repeats in (0.0, 0.05, 1.0):
        repeat_share(logged(neighbour_std=0.0, repeats=repeats), SETTINGS)
