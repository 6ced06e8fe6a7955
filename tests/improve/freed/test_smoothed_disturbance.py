"""Smoothed disturbances: a planted bump is where it was put, bands hold what they promise, shares are held out."""

import math
from dataclasses import replace

import numpy as np
import pytest
from campaigns import NOISE, RIG, campaign

from observer_fi.improve.freed.random_walk import likelihood, series_of, smoothed
from observer_fi.improve.freed.smoothed_disturbance import curve_of, free_equations
from observer_fi.improve.improvement import refitted
from observer_fi.learn.linear import TORQUE, linearised
from observer_fi.learn.move_data import run
from observer_fi.physics.rigs import with_values


@pytest.mark.slow
def test_a_bump_of_friction_shows_at_its_place():
    plant = with_values(RIG, {"friction_bump": 2e-5, "bump_position": 3e-4, "bump_width": 6e-5})
    rows, disturbances = free_equations(*refitted([campaign(plant, speeds=(410.0, 300.0), seed=5)], RIG))
    assert rows[0].equation == "torque"
    disturbance = next(one for one in disturbances if one.what.name == "torque")
    curve = disturbance.curves["position"]
    assert curve.at[np.nanargmax(curve.forward)] == pytest.approx(3e-4, abs=4e-5)
    assert curve.at[np.nanargmin(curve.backward)] == pytest.approx(3e-4, abs=4e-5)
    assert "position" in disturbance.goes_with and "speed" not in disturbance.goes_with
    assert np.nanmax(disturbance.mean) == pytest.approx(2e-5, rel=0.4)


@pytest.mark.slow
def test_bands_hold_what_they_promise():
    """Disturbances drawn from their own law along a simulated motion, many seeds: 95 % in the band, and the size comes back."""
    experiment, fitted = refitted([campaign(seed=9)], RIG)
    states, _ = run(experiment, fitted.model, fitted.nuisance)
    linear, series = linearised(experiment, fitted.model, states), series_of(experiment, fitted)
    series = series._replace(variance=np.where(np.isfinite(series.variance), experiment.noise**2, np.inf))
    series = series._replace(off=np.empty(0), precision=np.empty(0))
    size, memory, inside, best = 5e-6, 0.3, [], []
    for seed in range(12):
        rng = np.random.default_rng([9100, seed])
        s, y = drawn(linear, series, size, memory, rng)
        here = series._replace(y=y)
        mean, std = smoothed(linear, here, TORQUE, size, memory)
        inside.append(np.mean(np.abs(s - mean) < 1.96 * std))
        gains = [likelihood(linear, here, TORQUE, size * f, memory)[0] for f in (0.5, 1.0, 2.0)]
        best.append(int(np.argmax(gains)))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)  # twelve logs of some fifty independent stretches
    assert best.count(1) >= 11


def drawn(linear, series, size, memory, rng):
    """A random walk with memory and the readings (N, 3, 1) that it makes, from the linear system itself."""
    n = series.since.size
    s, d, y, move = np.zeros(n), np.zeros(3), np.zeros((n, 3, 1)), -1
    for k in range(n):
        keep = math.exp(-series.since[k] / memory) if k else 0.0
        before = s[k - 1] if k else 0.0
        if series.begins[k]:
            move += 1
            d = np.array([0.0, *(series.start[move] + rng.normal(size=2) * np.sqrt(series.start_var[move]))])
        else:
            f, g = linear.F[k - 1], linear.G[TORQUE, k - 1]
            if linear.held[k - 1]:
                d[0] = 0.0
            else:
                w, I, x = d
                d = (
                    np.array([f[0] * w + f[1] * I + f[2] * x, f[3] * w + f[4] * I, f[5] * w + f[6] * I + x])
                    + before * g
                )
        s[k] = keep * before + size * math.sqrt(1.0 - keep**2) * rng.normal()
        d[0] += math.sqrt(series.kick[k]) * rng.normal()
        d[1] += math.sqrt(series.caught[k]) * rng.normal()
        h = linear.H[k]
        y[k, :, 0] = [h[0] * d[0] + h[1] * d[1], h[2] * d[0] + h[3] * d[1], h[4] * d[0] + h[5] * d[2]]
    return s, y + rng.normal(size=y.shape) * NOISE[:, None]


def moves(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    owner = np.repeat(np.arange(count), 400)
    w = np.where(owner % 2 == 0, 100.0, -100.0)
    return owner, w, rng.uniform(0.0, 1.0, size=owner.size)


def test_share_is_what_other_moves_predict():
    owner, w, x = moves(6, np.random.default_rng(1))
    band = np.full(owner.size, 0.1)
    of_position = curve_of("position", x, w, owner, np.sin(6.0 * x) * np.sign(w), band)
    assert of_position.share > 0.95
    assert of_position.band == pytest.approx(0.1)
    assert np.nanmax(np.abs(of_position.forward + of_position.backward)) < 0.1
    own_level = np.random.default_rng(2).normal(size=6)[
        owner
    ]  # every move has its own, whatever the position
    assert curve_of("position", x, w, owner, own_level, band).share < 0.2
    assert curve_of("position", x, w, np.zeros_like(owner), np.sin(6.0 * x), band).share == 0.0


def test_angles_are_folded_and_levels_stay_levels():
    owner, w, x = moves(4, np.random.default_rng(3))
    y = np.cos(50.0 * x)
    folded = curve_of("shaft_angle", 50.0 * x, w, owner, y, np.zeros_like(y))
    assert folded.at.min() >= 0.0 and folded.at.max() <= 2.0 * np.pi and folded.share > 0.95
    pitch = np.array([0.0, 5.0, 10.0, 0.0])[owner]
    assert curve_of("pitch", pitch, w, owner, pitch, np.zeros_like(y)).at.tolist() == [0.0, 5.0, 10.0]


def test_a_path_that_never_turns_has_no_curve():
    experiment, fitted = refitted([campaign(seed=9)], RIG)
    still = replace(experiment, knots=tuple((t, 0.0 * v) for t, v in experiment.knots))
    rows, disturbances = free_equations(still, replace(fitted, residuals=fitted.residuals + 3.0))
    assert rows and all(disturbance.curves == {} for disturbance in disturbances)
