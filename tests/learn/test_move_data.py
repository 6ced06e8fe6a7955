"""Simulations side by side against one after another."""

from dataclasses import replace

import hidden
import numpy as np
import pytest
from campaigns import log_of

from observer_fi.learn import move_data as ex
from observer_fi.logs.ingest import log_from_frame
from observer_fi.logs.moves import Phase, log_phases, moves_from_rest
from observer_fi.physics import simulation as sim
from observer_fi.physics.rigs import Model, load_rig, override
from observer_fi.physics.scenario import Move, Scenario, synthesise
from observer_fi.records import Log

RIG = load_rig()
PLANTS = {
    "plain": {},
    "a term of every kind": {
        "viscous_positive": 1e-7, "stribeck_torque": 1e-4, "friction_slope": 1e-2, "screw_ripple_sin": 1e-5, "brush_drop": 0.1,
        "heating_gain": 0.1, "sag_resistance": 2.0, "integrator_limit": 1.0, "position_lag": 2e-3, "position_sin": 1e-5,
        "current_offset": 1e-3, "supply_drift": -0.1, "x_stop_high": 3e-4,
    },
    "play": {"backlash": 5e-5},
    "inner loop": {"current_lag": 5e-4, "servo_delay": 1e-4},
    "current behind the limit": {"current_lag": 5e-4, "lag_behind_limit": 1.0},
    "delays": {"servo_delay": 2e-4, "voltage_delay": 5e-4, "input_delay": 3e-4},
    "slow sensor": {"position_lag": 0.3, "position_gain": 1.1},
}  # fmt: skip


def moves() -> Log:
    """Forth, back and slowly forth, with rests."""
    way = (Move(0.3, 410.0, 0.4), Move(1.0, -410.0, 0.4), Move(1.7, 90.0, 0.3))
    return synthesise(Scenario(way, 2.4, pitch_deg=4.0, seed=3), RIG)[0]


def drawn(plant: dict[str, float], count: int) -> list[Model]:
    """Models around a plant: masses and frictions differ, and so stick and slip and saturation."""
    rng = np.random.default_rng(5)
    return [
        override(RIG.model, "drawn", **plant, **{n: RIG.model[n] * rng.uniform(0.8, 1.2) for n in ("A", "J", "Ki", "Vmax")})
        for _ in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("plant", PLANTS)
def test_side_by_side_is_as_one_after_another(plant: str) -> None:
    """Ten sets: a full register and a part of one. To rounding, which a slip at the edge of friction carries on."""
    experiment, models = ex.prepare([moves()], RIG), drawn(PLANTS[plant], 10 + ex._WORTH_LANES - 2)
    rng = np.random.default_rng(6)
    nuisances = [rng.normal(size=(experiment.moves, 2)) * (1e-4, 1e-6) for _ in models]
    together = ex.simulate_each(experiment, models, nuisances)
    assert np.ptp(together, axis=0).max() > 0.1
    for got, model, nuisance in zip(together, models, nuisances, strict=True):
        alone = ex.simulate(experiment, model, nuisance)
        np.testing.assert_allclose(got, alone, rtol=0.0, atol=1e-9)


def test_sets_with_other_steps_and_delays_are_kept_apart() -> None:
    experiment, models = ex.prepare([moves()], RIG), []
    for plant in PLANTS.values():
        models += drawn(plant, 3)
    still = np.zeros((experiment.moves, 2))
    together = ex.simulate_each(experiment, models, [still] * len(models))
    for got, model in zip(together, models, strict=True):
        np.testing.assert_allclose(got, ex.simulate(experiment, model, still), rtol=0.0, atol=1e-9)
    assert len({(ex._delays(m.vector), sim.paced(m.vector)) for m in models}) == 4


def test_rows_of_a_fit_have_the_phases_of_their_log() -> None:
    log = moves()
    experiment = ex.prepare([log], RIG)
    codes = log_phases(log, RIG.model)
    np.testing.assert_array_equal(experiment.phase, codes[np.searchsorted(log.t, experiment.t)])
    some = ex.select(experiment, [2, 0])
    np.testing.assert_array_equal(some.phase, codes[np.searchsorted(log.t, some.t)])
    assert set(experiment.phase) == set(Phase)


def test_too_many_moves_are_drawn_from_the_whole_of_a_log(monkeypatch: pytest.MonkeyPatch) -> None:
    log = moves()
    segments, whole = moves_from_rest(log), ex.prepare([log], RIG)
    assert ex.spread_moves(segments, 1.0) == [0, 1, 2] and ex.too_many_moves([log], RIG) == ""
    monkeypatch.setattr(ex, "MOST_ROWS", ex.samples_of(segments) - 1)
    assert ex.share_of([segments, segments], ex.samples_of(segments)) == 0.5
    said = ex.too_many_moves([log], RIG, ex.MOST_ROWS)
    taken = ex.spread_moves(segments, 0.99)
    assert said.startswith("3 moves are more than are fitted at once") and f": {len(taken)} of them" in said
    few = ex.prepare([log], RIG, share=0.99)
    assert few.moves == len(taken) < 3
    for k, m in enumerate(
        taken
    ):  # as they are among all: with the direction of the move before, and its place in the log
        assert (few.before[k], few.start[k]) == (whole.before[m], whole.start[m])
        np.testing.assert_array_equal(few.z[few.rows(k)], whole.z[whole.rows(m)])
    assert len(ex.spread_moves(segments, 1e-9)) == 1
    many = segments * 200
    drawn_moves = np.array(ex.spread_moves(many, 0.3))
    assert 0.25 < drawn_moves.size / len(many) < 0.33
    assert np.histogram(drawn_moves, 6, (0, len(many)))[0].min() > 15  # from everywhere
    assert np.bincount(drawn_moves % 3).min() > 40  # and of every kind


# --- how much a reading counts -------------------------------------------------------------------


@pytest.mark.parametrize("slope", [150.0, -800.0])  # V/s
@pytest.mark.parametrize("jitter", [0.0, 0.02, 0.05])  # of a sampling interval
def test_what_changes_fast_counts_less_where_the_clock_jitters(slope: float, jitter: float) -> None:
    log = moves()
    late = jitter / log.rate_hz * np.random.default_rng(1).standard_normal(log.t.size).clip(-3.0, 3.0)
    t = log.t + late
    z = log.z.copy()
    z[:, 0] += np.where(log.w_cmd != 0.0, slope * t - z[:, 0], 0.0)
    experiment = ex.prepare([replace(log, t=t, z=z)], RIG)
    off = slope * jitter / log.rate_hz  # of a voltage that is read so late
    steep = np.concatenate([np.abs(experiment.w_cmd(m)) > 0.0 for m in range(experiment.moves)])
    weight = np.median(experiment.weight[steep, 0])
    assert weight == pytest.approx(1.0 / np.hypot(experiment.noise[0], off), rel=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_of_an_even_clock_every_reading_counts_alike(seed: int) -> None:
    experiment = ex.prepare([log_of(SHORT, seed=seed)], RIG)
    for c in range(3):
        weight = experiment.weight[:, c]
        np.testing.assert_allclose(weight[weight > 0.0], 1.0 / experiment.noise[c], rtol=1e-12)


SHORT = hidden.there_and_back((410.0, 300.0), (0.4, 0.4), (0.0, 8.0))


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_drive_that_is_off_leaves_open_what_it_holds_next(seed: int) -> None:
    """Its readings say zero, and as soon as it is on it has to hold the mass: anything up to what it ever drove."""
    spec = hidden.TruthSpec(SHORT)
    off = ex.prepare([log_from_frame(hidden.make_log_with("drive_off", spec, seed)[0])], RIG)
    on = ex.prepare([log_of(SHORT, seed=seed)], RIG)
    np.testing.assert_allclose(off.nuisance_std[:, 0], np.abs(off.z[:, 1]).max())
    assert (on.nuisance_std[:, 0] < 1e-4).all()
    np.testing.assert_allclose(off.nuisance_std[:, 1], on.nuisance_std[:, 1], rtol=0.1)


@pytest.mark.parametrize("rate, every", [(200.0, True), (400.0, True), (800.0, False), (1600.0, False)])
def test_a_slow_log_is_integrated_in_fine_steps_throughout(rate: float, every: bool) -> None:
    experiment = ex.prepare([log_of(SHORT, logger=hidden.Logger(rate_hz=rate))], RIG)
    assert experiment.fine.any() and experiment.fine.all() == every


@pytest.mark.parametrize("lag", [0.01, 0.3])
def test_a_sensor_that_lags_is_still_behind_as_the_next_move_starts(lag: float) -> None:
    """Against the independent truth: had it begun where the mass is, 0.3 s of lag would be ten sigmas off."""
    log = log_of(
        hidden.there_and_back((410.0,), (0.6,), (0.0,), rest_s=0.25),
        effects=(hidden.effect("position_lag", lag=lag),),
    )
    experiment = ex.prepare([log], RIG)
    model = override(RIG.model, "late", position_lag=lag)
    y = ex.simulate(experiment, model, np.zeros((experiment.moves, 2)))
    later = experiment.rows(1)
    off = ((experiment.z - y) * experiment.weight)[later, 2]
    assert experiment.moves == 2 and np.sqrt(np.mean(off**2)) < 2.5


def test_moves_that_do_not_begin_at_rest_are_left_out() -> None:
    log = moves()
    starts = [segment.start for segment in moves_from_rest(log)]
    swing = np.where(log.t < log.t[starts[2]], np.sin(140.0 * log.t), 0.0) * (log.t > log.t[starts[2]] - 0.1)
    rings = replace(log, z=log.z + swing[:, None] * np.array([1.0, 0.1, 0.0]))
    spikes = log.z.copy()
    spikes[[start - 20 for start in starts], :2] += (5.0, 0.5)
    noise = np.random.default_rng(3).standard_normal(log.z.shape) * [1.5, 0.1, 0.0]
    hum = np.sin(100.0 * np.pi * log.t)[:, None] * np.array([0.3, 0.02, 0.0])
    logs = {"still": log.z, "rings": rings.z, "spikes": spikes, "noise": log.z + noise, "hum": log.z + hum}
    kept = {name: ex.prepare([replace(log, z=z)], RIG).start.size for name, z in logs.items()}
    assert kept == {"still": 3, "rings": 2, "spikes": 3, "noise": 3, "hum": 3}
