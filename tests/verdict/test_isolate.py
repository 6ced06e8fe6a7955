"""The decision rule on estimates made by hand, where the right verdict is known."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from observer_fi.physics import LABELS, channel_of, label_of, words_of
from observer_fi.records import Estimate, Event, Isolation
from observer_fi.settings import DecisionSettings
from observer_fi.verdict import isolate
from observer_fi.verdict.isolate import EventTracker, Isolator, Whiteness, log_verdict

MODES = (
    "nominal",
    "overload",
    "coupling_loss",
    "unknown",
    "sensor:voltage",
    "sensor:current",
    "sensor:position",
)
MIXTURE = MODES[:3]
RATE = 1600.0
SETTINGS = DecisionSettings()


class Part(NamedTuple):
    """A stretch of an estimate: how long, which hypothesis with which probability, its NIS; command 0 is a rest."""

    seconds: float
    mode: str = "nominal"
    p: float = 0.999
    nis: float = 3.0
    command: float = 410.0
    active: bool = True
    others: float = 50.0  # NIS of the other hypotheses
    strain: float = 0.0  # of that hypothesis


def rest(seconds: float = 0.2, nis: float = 3.0, **others: float) -> Part:
    return Part(seconds, nis=nis, command=0.0, active=False, others=others.get("others", nis))


def estimate(*parts: Part, modes: tuple[str, ...] = MODES) -> Estimate:
    m, rows = len(modes), []
    for part in parts:
        n = round(part.seconds * RATE)
        j = modes.index(part.mode)
        p = np.full((n, m), (1.0 - part.p) / (m - 1))
        p[:, j] = part.p
        nis = np.full((n, m), part.others)
        nis[:, j] = part.nis
        strain = np.zeros((n, m))
        strain[:, j] = part.strain
        states = np.tile([part.command, 0.05, 0.0, part.command], (n, 1))
        seen = np.full((n, 3), np.sqrt(part.nis / 3.0))
        rows.append((p, nis, strain, states, seen, np.full(n, part.active)))
    p, nis, strain, states, seen, active = (np.concatenate(column) for column in zip(*rows, strict=True))
    n = active.size
    return Estimate(
        np.arange(n) / RATE,
        modes,
        p,
        nis,
        np.zeros((n, m, 3)),
        seen,
        states,
        active,
        np.zeros((n, m)),
        strain,
    )


def isolated(e: Estimate, *cuts: int, settings: DecisionSettings = SETTINGS) -> Isolation:
    """Isolation of an estimate that comes in pieces cut at these samples."""
    isolator = Isolator(e.modes, settings)
    edges = [0, *sorted(cuts), e.t.size]
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        for _ in isolator.add(part_of(e, a, b)):
            pass
    return isolator.result()


def part_of(e: Estimate, first: int, last: int) -> Estimate:
    names = ("t", "probability", "nis", "predicted", "normalised", "states", "active", "density", "strain")
    return replace(e, **{name: getattr(e, name)[first:last] for name in names})


def verdict(*parts: Part, modes: tuple[str, ...] = MODES) -> Event:
    return isolated(estimate(*parts, modes=modes)).verdict


# --- one move ------------------------------------------------------------------------------------


def test_names_of_modes_and_labels() -> None:
    assert [label_of(m) for m in MODES] == [
        "nominal",
        "overload",
        "coupling_loss",
        "unknown",
        *["sensor_fault"] * 3,
    ]
    assert [channel_of(m) for m in MODES[3:]] == [None, "voltage", "current", "position"]


def test_a_healthy_move() -> None:
    v = verdict(rest(), Part(1.0), rest())
    assert (v.label, v.channel, v.detected_s, v.reasons) == ("nominal", None, None, ())
    assert v.isolated_s == pytest.approx(0.2) and v.probability == pytest.approx(0.999)
    assert sum(v.posterior.values()) == pytest.approx(1.0) and set(v.posterior) == set(LABELS)


@pytest.mark.parametrize(
    ("mode", "modes"), [(mode, modes) for modes in (MODES, MIXTURE) for mode in modes[1:]]
)
def test_a_fault_is_isolated_where_it_became_certain_for_good(mode: str, modes: tuple[str, ...]) -> None:
    v = verdict(rest(), Part(0.3), Part(0.05, mode, 0.6), Part(0.02, mode), Part(0.01, mode, 0.94), Part(0.6, mode), rest(),
                modes=modes)  # fmt: skip
    assert (v.label, v.channel) == (label_of(mode), channel_of(mode))
    assert v.isolated_s == pytest.approx(0.58) and v.detected_s == pytest.approx(0.5)
    assert v.probability >= 0.999  # two more sensors add theirs
    assert v.onset_s is None  # placed by onset.py


def test_the_last_word_of_the_move_counts_not_the_first() -> None:
    v = verdict(rest(), Part(0.3), Part(0.3, "overload"), Part(0.3, "coupling_loss"), rest())
    assert v.label == "coupling_loss" and v.isolated_s == pytest.approx(0.8)


@pytest.mark.parametrize(("seconds", "label"), [(0.09, "nominal"), (0.11, "overload")])
def test_a_fault_that_came_and_went_counts_if_it_was_certain_for_long(seconds: float, label: str) -> None:
    v = verdict(rest(), Part(0.3), Part(seconds, "overload"), Part(0.5), rest())
    assert v.label == label
    if label == "overload":
        assert v.isolated_s == pytest.approx(0.5) and "came and went" in v.reasons[0]
        assert v.posterior["overload"] == pytest.approx(SETTINGS.isolated)


@pytest.mark.parametrize(("nis", "label"), [(7.5, "nominal"), (15.0, "sensor_fault")])
def test_a_sensor_fault_that_came_and_went_must_leave_nominal_at_a_loss(nis: float, label: str) -> None:
    """The start of a rig whose gains are off doubts a sensor for a while, but nominal explains it nearly as well."""
    v = verdict(rest(), Part(0.3), Part(0.2, "sensor:voltage", others=nis), Part(0.5), rest())
    assert v.label == label


def test_doubt_that_passes_is_no_fault() -> None:
    assert verdict(rest(), Part(0.3), Part(0.4, "overload", 0.9), Part(0.3), rest()).label == "nominal"
    assert verdict(rest(), Part(0.3), Part(0.4, "unknown"), Part(0.3), rest()).label == "nominal"


# --- the absolute tests --------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["nominal", "overload", "sensor:current"])
@pytest.mark.parametrize(("nis", "fits"), [(4.0, True), (5.9, True), (6.1, False), (20.0, False)])
def test_the_winner_has_to_explain_the_innovations(mode: str, nis: float, fits: bool) -> None:
    v = verdict(rest(), Part(0.3), Part(0.1, mode), Part(0.5, mode, nis=nis), rest())
    assert v.label == (label_of(mode) if fits else "unknown")
    if not fits:
        assert words_of(mode) in v.reasons[-1] and "does not explain" in v.reasons[-1]
        share = (6.0 - 3.0) / (nis - 3.0)  # of a window, until its mean is twice what is expected
        assert v.isolated_s == pytest.approx(0.6 + share * SETTINGS.window_s, abs=3 / RATE)


def test_without_a_hypothesis_for_the_unknown_the_best_wins() -> None:
    assert verdict(rest(), Part(0.5, nis=50.0), rest(), modes=MIXTURE).label == "nominal"


def test_a_misfit_before_anything_is_certain_is_not_held_against_the_winner() -> None:
    assert (
        verdict(rest(), Part(0.3), Part(0.5, "overload", 0.9, nis=50.0), Part(0.3, "overload"), rest()).label
        == "overload"
    )


def test_a_short_misfit_is_no_misfit() -> None:
    """One sample in a window of 160 may be as far off as it likes only up to what moves the mean to its limit."""
    assert verdict(rest(), Part(0.3), Part(1 / RATE, nis=300.0), Part(0.3), rest()).label == "nominal"
    assert verdict(rest(), Part(0.3), Part(1 / RATE, nis=600.0), Part(0.3), rest()).label == "unknown"


@pytest.mark.parametrize(("strain", "label"), [(4.4, "overload"), (4.6, "unknown")])
def test_constants_that_no_rig_shows_are_an_unknown_fault(strain: float, label: str) -> None:
    v = verdict(rest(), Part(0.3), Part(0.5, "overload", strain=strain), rest())
    assert v.label == label
    assert v.posterior[label] > 0.99
    if label == "unknown":
        assert "overload would fit only with constants" in v.reasons[0]


def test_probabilities_still_sum_to_one_after_the_test_of_constants() -> None:
    e = estimate(Part(0.1, "overload", 0.7, strain=9.0))
    p = isolate.tested(e, SETTINGS).probability
    np.testing.assert_allclose(p.sum(axis=1), 1.0)
    np.testing.assert_allclose(p[:, 3], 0.75)
    assert (p[:, 1] == 0.0).all()
    assert (e.probability[:, 1] == 0.7).all()


# --- stop and rest -------------------------------------------------------------------------------


def sensor_at_rest(nominal: float, position: float) -> Estimate:
    e = estimate(rest(), Part(0.5), rest(0.3))
    after = ~e.active & (e.t > 0.5)
    e.nis[after] = nominal
    e.nis[after, 6] = position
    return e


def test_a_rest_shows_a_dead_sensor() -> None:
    v = isolated(sensor_at_rest(28.0, 3.0)).verdict
    assert (v.label, v.channel, v.isolated_s) == ("sensor_fault", "position", None)
    assert "the stop and the rest" in v.reasons[0]


@pytest.mark.parametrize(("nominal", "position"), [(11.0, 3.0), (28.0, 27.5)])
def test_a_rest_that_no_sensor_explains_or_that_is_fine_changes_nothing(
    nominal: float, position: float
) -> None:
    assert isolated(sensor_at_rest(nominal, position)).verdict.label == "nominal"


def test_a_rest_never_overturns_a_fault() -> None:
    e = estimate(rest(), Part(0.3), Part(0.3, "overload"), rest(0.5))
    e.nis[~e.active] = 30.0
    e.nis[~e.active, 6] = 1.0
    e.probability[e.t > 0.81] = np.eye(7)[0]
    assert isolated(e).verdict.label == "overload"


def test_of_two_sensors_that_explain_a_rest_the_whole_stop_chooses_whatever_the_chunks() -> None:
    e = sensor_at_rest(28.0, 3.0)
    stop = np.flatnonzero(~e.active & (e.t > 0.5))
    e.nis[stop, 5] = 3.0  # the current's sensor explains the rest as well
    e.density[stop[:10], 1] = 5.0  # first a fault is likely and the position's sensor better,
    e.density[stop[:10], 6] = 1.0
    e.density[stop[10:30], 5] = 1.0  # then that of the current
    for cuts in ((), range(stop[0], stop[-1]), (int(stop[12]),)):
        assert isolated(e, *cuts).verdict.channel == "current"


def test_one_wild_sample_of_a_rest_counts_ten_times_at_most() -> None:
    e = sensor_at_rest(3.0, 3.0)
    e.nis[-1] = 1e9
    e.nis[-1, 6] = 0.0
    assert isolated(e).verdict.label == "nominal"


def test_missing_samples_say_nothing() -> None:
    e = estimate(rest(), Part(0.5), rest(0.3))
    e.nis[:] = np.nan
    e.normalised[:] = np.nan
    found = isolated(e)
    assert found.verdict.label == "nominal" and np.isnan(found.consistency.whiteness_p)


@pytest.mark.parametrize("measured", [True, False])
def test_a_sensor_that_is_not_there_has_not_failed(measured: bool) -> None:
    """The winner shows no innovation of the sensor that it takes for failed; before and after, the channel speaks for itself."""
    parts = (rest(), Part(0.3), Part(0.4, "sensor:voltage"), rest(), Part(0.4, "sensor:voltage"), rest())
    e = estimate(*parts)
    failed = e.probability.argmax(axis=1) == MODES.index("sensor:voltage")
    e.normalised[failed | (not measured), 0] = np.nan
    found = isolated(e)
    expected = ("sensor_fault", "voltage") if measured else ("unknown", None)
    assert [(v.label, v.channel) for v in found.events] == [expected] * 2
    assert (
        "the voltage is not measured, so its sensor cannot be what is wrong" in found.verdict.reasons
    ) != measured
    assert found.verdict.probability >= 0.999


# --- several moves -------------------------------------------------------------------------------


def test_every_move_has_its_verdict_and_the_log_its_first_fault() -> None:
    found = isolated(estimate(
        rest(), Part(0.4), rest(), Part(0.2), Part(0.3, "sensor:current"), rest(), Part(0.4, "overload"), rest(),
        Part(0.4), rest(),
    ))  # fmt: skip
    assert [e.label for e in found.events] == ["nominal", "sensor_fault", "overload", "nominal"]
    assert found.verdict is found.events[1]
    starts = [0.2, 0.8, 1.5, 2.1]
    assert [e.start_s for e in found.events] == pytest.approx(starts)
    assert [e.end_s for e in found.events] == pytest.approx([s - 1 / RATE for s in [*starts[1:], 2.7]])


def test_of_healthy_moves_the_least_certain_speaks_for_the_log() -> None:
    found = isolated(estimate(rest(), Part(0.4), rest(), Part(0.4, p=0.97), rest(), Part(0.4), rest()))
    assert found.verdict is found.events[1]


def test_a_slower_command_is_no_stop() -> None:
    found = isolated(
        estimate(rest(), Part(0.3), Part(0.01, active=False, command=300.0), Part(0.3, command=205.0), rest())
    )
    assert len(found.events) == 1


def test_a_log_that_begins_in_motion_has_a_move() -> None:
    assert len(isolated(estimate(Part(0.3), rest())).events) == 1


def test_a_log_without_a_move_says_so() -> None:
    found = isolated(estimate(rest(0.5)))
    assert (found.events, found.verdict.label, found.verdict.posterior["nominal"]) == ((), "not_tested", 0.0)
    assert "no move" in found.verdict.reasons[0]
    assert log_verdict([]) == found.verdict


# --- the end of a move ---------------------------------------------------------------------------


@pytest.mark.parametrize("before", ["nominal", "coupling_loss"])
def test_a_winner_that_comes_up_as_a_move_ends_is_none(before: str) -> None:
    """Seven samples, 4.4 ms: what a jolt of the brake does before the filters settle."""
    parts = (rest(), Part(0.3), Part(0.4, before), Part(7 / RATE, "overload"), rest())
    assert verdict(*parts).label == before
    assert (
        verdict(rest(), Part(0.3), Part(0.4, before), Part(20 / RATE, "overload"), rest()).label == "overload"
    )


def test_while_the_move_goes_on_the_winner_counts_at_once() -> None:
    e = estimate(rest(), Part(0.7), Part(4 / RATE, "overload"))
    assert isolated(e).verdict.label == "overload"
    assert (
        isolated(estimate(rest(), Part(4 / RATE, "overload"), rest())).verdict.label == "overload"
    )  # there was none before


def test_two_winners_that_come_up_as_a_move_ends_are_none() -> None:
    parts = (Part(0.7), Part(4 / RATE, "overload"), Part(5 / RATE, "coupling_loss"))
    assert verdict(rest(), *parts, rest()).label == "nominal"
    assert verdict(rest(), *parts, Part(4 / RATE), rest()).label == "nominal"


@given(samples=st.integers(1, 12), cuts=st.lists(st.integers(2, 1799), max_size=20))
def test_chunks_make_no_difference_to_the_end_of_a_move(samples: int, cuts: list[int]) -> None:
    e = estimate(rest(), Part(0.5), Part(samples / RATE, "overload"), rest(0.3))
    last = round(0.7 * RATE)
    every = [*range(last - 3, last + samples + 3), *cuts]
    same(isolated(e), isolated(e, *sorted({k for k in every if k < e.t.size})))
    assert isolated(e).verdict.label == ("nominal" if samples < isolate.SETTLING else "overload")


# --- laws ----------------------------------------------------------------------------------------

PARTS = st.builds(
    Part, st.floats(0.01, 0.25), st.sampled_from(MODES), st.sampled_from((0.4, 0.9, 0.96, 1.0)), st.sampled_from((2.9, 5.0, 9.0)),
    st.sampled_from((410.0, 205.0)), st.booleans(), st.just(40.0), st.sampled_from((0.0, 4.0, 5.0)),
)  # fmt: skip
LOGS = st.lists(
    st.one_of(PARTS, PARTS, st.builds(rest, st.floats(0.01, 0.2), st.sampled_from((3.0, 28.0)))),
    min_size=1,
    max_size=9,
)


def same(one: Isolation, two: Isolation) -> None:
    assert one.events == two.events and one.verdict == two.verdict
    np.testing.assert_allclose(one.consistency, two.consistency, rtol=1e-9)


@given(parts=LOGS, seed=st.integers(0, 9), pieces=st.integers(1, 12))
def test_chunks_make_no_difference(parts: list[Part], seed: int, pieces: int) -> None:
    e = estimate(*parts)
    cuts = np.random.default_rng(seed).integers(2, max(e.t.size - 1, 3), pieces)
    same(isolated(e), isolated(e, *(int(c) for c in cuts if c < e.t.size)))


def test_nor_do_single_samples() -> None:
    e = estimate(
        rest(), Part(0.2), Part(0.15, "overload"), Part(0.1, nis=9.0), rest(0.1, nis=20.0), Part(0.2, "sensor:voltage"),
        rest(0.1), Part(0.1), Part(0.3, "overload", nis=9.0), rest(0.1),
    )  # fmt: skip
    found = isolated(e)
    assert [v.label for v in found.events] == ["overload", "sensor_fault", "unknown"]
    same(found, isolated(e, *range(9, e.t.size)))


@given(parts=LOGS, share=st.floats(0.05, 1.0))
def test_later_samples_never_move_an_isolation(parts: list[Part], share: float) -> None:
    """Causality: what has been isolated stays where it was for as long as the verdict stays the same."""
    e = estimate(*parts)
    early = isolated(part_of(e, 0, max(2, int(share * e.t.size))))
    late = isolated(e)
    for one, two in zip(early.events, late.events, strict=False):
        assert one.start_s == two.start_s
        if (one.label, one.channel) == (two.label, two.channel) and one.isolated_s is not None:
            assert two.isolated_s is None or two.isolated_s >= one.isolated_s
    for one, two in zip(early.events[:-1], late.events, strict=False):
        assert one == two  # a move that is over keeps its verdict


@given(parts=LOGS)
def test_a_verdict_is_always_whole(parts: list[Part]) -> None:
    for event in isolated(estimate(*parts)).events:
        assert event.label in LABELS and (event.channel is None) == (event.label != "sensor_fault")
        assert sum(event.posterior.values()) == pytest.approx(1.0)
        assert event.probability == event.posterior[event.label]
        assert event.posterior[event.label] == max(event.posterior.values())
        if event.isolated_s is not None:
            assert event.start_s <= event.isolated_s <= event.end_s
            assert event.detected_s is None or event.detected_s <= event.isolated_s


# --- consistency ---------------------------------------------------------------------------------


def innovations(v: np.ndarray) -> Estimate:
    e = estimate(Part(v.shape[0] / RATE))
    return replace(e, normalised=v)


def whiteness(v: np.ndarray) -> float:
    w = Whiteness()
    w.add(innovations(v))
    return w.result().whiteness_p


def test_whiteness_of_white_noise_is_uniform_and_of_coloured_noise_small() -> None:
    p = np.array([whiteness(np.random.default_rng(s).normal(size=(1600, 3))) for s in range(1000)])
    for level, expected in ((0.01, 0.01), (0.05, 0.049), (0.1, 0.097)):  # 1 - (1 - level / 3)^3
        assert np.mean(p < level) == pytest.approx(expected, abs=4.0 * np.sqrt(expected / p.size))
    coloured = np.random.default_rng(0).normal(size=(1600, 3))
    coloured[1:, 1] = 0.98 * coloured[1:, 1] + 0.2 * coloured[:-1, 1]
    assert whiteness(coloured) < 1e-6


def test_mean_nis_counts_channels_that_were_measured() -> None:
    v = np.random.default_rng(1).normal(size=(20000, 3))
    v[::2, 0] = np.nan
    w = Whiteness()
    w.add(innovations(v))
    found = w.result()
    assert found.nis_expected == pytest.approx(2.5) and found.nis_mean == pytest.approx(
        2.5, abs=0.06
    )  # 4 sigma


@pytest.mark.parametrize("q", [0.0, 1e-3, 3.0, 18.3, 300.0, 1e8])
def test_the_tail_of_a_chi_square_is_that_of_scipy(q: float) -> None:
    for freedoms in (2, 10):
        assert isolate._chi_square_tail(q, freedoms) == pytest.approx(chi2.sf(q, freedoms), rel=1e-12)


def test_health_in_place_of_a_first_fault_leaves_the_one_behind_it() -> None:
    posterior = {label: float(label == "unknown") for label in LABELS}
    behind = Event("unknown", None, 1.0, 1.1, (1.0, 1.2), None, None, 0.2, 2.0, posterior)
    first = behind._replace(label="jam", onset_s=0.3, end_s=2.5, then=(behind,))
    assert isolate.healthy(first) == behind._replace(end_s=2.5)
    assert isolate.healthy(first._replace(then=())).label == "nominal"


def test_the_arrays_of_an_estimate_may_be_used_again() -> None:
    """A stream's next samples stand where the last ones stood: the winner before the stop must not become that of the stop."""
    stop = Part(0.2, "sensor:current", command=0.0, active=False, others=3.0)
    whole = estimate(Part(0.5), Part(3.0 / RATE, "sensor:current"), stop)
    tracker, room = EventTracker(MODES, 0.0, SETTINGS), whole.probability[:1].copy()
    for k in range(whole.t.size):
        room[:] = whole.probability[k]
        tracker.add(replace(part_of(whole, k, k + 1), probability=room), 1.0 / RATE)
    assert tracker.verdict().label == "nominal"
