"""Loggers that take running means of voltage or current: of what they are the means is judged."""

from dataclasses import replace

import numpy as np
import pytest
from hidden import draw_move_case, make_log
from scipy.signal import butter, lfilter, lfilter_zi

from observer_fi.logs import log_from_frame
from observer_fi.logs.logger.means import Unmeant, means_of
from observer_fi.physics import load_rig
from observer_fi.records import Log
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG, SETTINGS = load_rig(), Settings()
CLASSES = ("nominal", "overload", "coupling_loss")


def averaged(
    seed: int, channels: tuple[int, ...], samples: int, *, ahead: bool = False, step: float = 0.0
) -> tuple[Log, Log]:
    """A move as it was, and with means of `samples` in some channels, rounded to `step` of their noise."""
    log = log_from_frame(make_log(draw_move_case(seed, CLASSES[seed % 3]), seed)[0])
    z = log.z.copy()
    for c in channels:
        known = np.concatenate((np.full(samples - 1, z[: 2 * samples, c].mean()), z[:, c]))
        mean = np.convolve(known, np.full(samples, 1.0 / samples), mode="valid")
        z[:, c] = np.roll(mean, -(samples // 2)) if ahead else mean
        if ahead:
            z[-(samples // 2) :, c] = mean[-1]
        if step:
            width = step * RIG.noise_std[c]
            z[:, c] = np.round(z[:, c] / width) * width
    return log, replace(log, z=z)


@pytest.mark.parametrize("step", [0.0, 0.001])
@pytest.mark.parametrize(("c", "samples"), [(0, 5), (0, 16), (1, 8), (1, 31)])
def test_what_a_mean_is_of_is_known_but_for_its_first_window(c: int, samples: int, step: float) -> None:
    for seed in range(76_000, 76_004):
        before, log = averaged(seed, (c,), samples, step=step)
        means = means_of(log)
        assert [(mean.channel, mean.samples) for mean in means] == [(c, samples)]
        found = Unmeant(means).take(log).z[2 * samples :, c]
        off = found - before.z[2 * samples :, c]
        assert off.std() < 0.6 * RIG.noise_std[c]
        with_it = log.z[2 * samples :, c] - before.z[2 * samples :, c]
        assert np.abs(off).max() < 0.2 * np.abs(with_it).max()


def test_chunks_are_as_good_as_a_whole_log() -> None:
    _, log = averaged(76_010, (0, 1), 12)
    means = means_of(log)
    whole = Unmeant(means).take(log).z
    for rows in (1, 5, 12, 777):
        stream = Unmeant(means)
        parts = [stream.take(log.part(slice(k, k + rows))).z for k in range(0, log.t.size, rows)]
        np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0.0, atol=1e-9)


def test_means_that_are_rounded_too_much_are_left_alone() -> None:
    """What rounding adds up to, from window to window, would be more than the noise."""
    assert means_of(averaged(76_013, (0,), 16, step=0.3)[1]) == ()


def test_means_of_missing_rows_and_of_no_rest_are_left_alone() -> None:
    _, log = averaged(76_011, (0,), 12)
    assert means_of(log)
    kept = np.random.default_rng(1).random(log.t.size) > 0.02
    assert means_of(log.part(np.flatnonzero(kept))) == ()
    assert means_of(log.part(slice(1_000, None))) == ()
    plain = log_from_frame(make_log(draw_move_case(76_012, "nominal"), 76_012)[0])
    assert means_of(plain) == ()


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("corner_hz", [30.0, 100.0, 300.0])
@pytest.mark.first(2)
def test_a_low_pass_is_no_mean(order: int, corner_hz: float) -> None:
    """Behind one of second order, changes some ten readings apart are opposite too, but neighbours are alike still more."""
    b, a = butter(order, corner_hz, fs=1600.0)
    for seed in range(76_200, 76_212):
        log = log_from_frame(make_log(draw_move_case(seed, "nominal"), seed)[0])
        z = log.z.copy()
        for c in range(2):
            z[:, c] = lfilter(b, a, z[:, c], zi=lfilter_zi(b, a) * z[0, c])[0]
        assert means_of(replace(log, z=z)) == ()


KINDS = {"voltage": (0,), "current": (1,), "both": (0, 1)}


def is_right(seed: int, kind: str) -> bool:
    rng = np.random.default_rng(seed)
    samples = int(rng.integers(4, 33)) | 1
    log = averaged(
        seed, KINDS[kind], samples, ahead=bool(rng.integers(2)), step=float(rng.choice((0.0, 0.001)))
    )[1]
    found = diagnose_log(log, RIG, SETTINGS).isolation
    assert found is not None
    return found.verdict.label == CLASSES[seed % 3]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "kind"), list(zip(range(76_020, 76_026), 2 * list(KINDS), strict=True)))
@pytest.mark.first(2)
def test_a_verdict_does_not_depend_on_the_means(seed: int, kind: str) -> None:
    assert is_right(seed, kind)


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("kind", KINDS)
def test_most_verdicts_do_not(kind: str) -> None:
    assert sum(is_right(seed, kind) for seed in range(76_100, 76_109)) >= 8
