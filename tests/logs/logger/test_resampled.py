"""Channels that were put on the rows of a table by straight lines between their readings."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hidden import CHANNELS, FAILURES, draw_failing_case, draw_move_case, make_log, write_log
from hidden.loggers import TRAITS, make_log_with
from other_clocks import READ, on_other_clocks

from observer_fi.logs import log_from_frame, open_log, read_log
from observer_fi.logs.logger.resampled import interpolated, lost, out_of_range
from observer_fi.physics import load_rig


def move(seed: int) -> pd.DataFrame:
    return make_log(draw_move_case(seed, "overload"), seed)[0]


@pytest.mark.parametrize("jitter", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(71_000, 71_006))
def test_only_the_readings_are_taken_from_which_lines_were_drawn(seed: int, jitter: float) -> None:
    hz = tuple(np.random.default_rng(seed).uniform((150.0, 150.0, 20.0), (500.0, 500.0, 400.0)).tolist())
    frame = move(seed)
    lines = on_other_clocks(frame, hz, seed, jitter=jitter)
    for column, rate in zip(READ, hz, strict=True):
        found = interpolated(lines["time_s"].to_numpy(), lines[column].to_numpy())
        assert found is not None and found.rate_hz == pytest.approx(rate, rel=0.04)
        assert found.own.sum() == pytest.approx(rate * np.ptp(lines["time_s"]), rel=0.04)
        same = lines[column].to_numpy() == frame[column].to_numpy()
        assert found.own[1:-1][~same[1:-1]].mean() < 0.02 < same.mean()


@pytest.mark.parametrize("name", sorted(TRAITS))
def test_what_loggers_do_is_no_line(name: str) -> None:
    frame, _ = make_log_with(name, draw_move_case(71_010, "nominal"), 71_010)
    for column in set(READ) & set(frame):
        assert interpolated(frame["time_s"].to_numpy(), frame[column].to_numpy(dtype=float)) is None


@pytest.mark.parametrize("seed", range(71_020, 71_024))
def test_steps_of_any_size_are_no_lines(seed: int) -> None:
    frame, rng = move(seed), np.random.default_rng(seed)
    for column, sigma in zip(READ, load_rig().noise_std, strict=True):
        step = sigma * 10.0 ** rng.uniform(-2.0, 2.0)
        y = np.round(frame[column].to_numpy() / step) * step
        assert interpolated(frame["time_s"].to_numpy(), y) is None


def test_a_simulation_without_noise_is_taken_whole() -> None:
    t = np.arange(0.0, 4.0, 1.0 / 1600.0)
    x = 2e-3 * np.clip(t - 0.5, 0.0, 2.0) + 1e-4 * np.exp(-5.0 * np.clip(t - 0.5, 0.0, None)) * (t > 0.5)
    assert interpolated(t, x) is None
    assert interpolated(t, np.round(x, 6)) is None


@pytest.mark.parametrize("column", READ)
def test_gaps_that_were_filled_are_gaps(column: str) -> None:
    frame = move(71_030)
    y = frame[column].to_numpy().copy()
    for first in (2_000, 5_000):
        y[first : first + 201] = np.linspace(y[first], y[first + 200], 201)
    found = interpolated(frame["time_s"].to_numpy(), y)
    assert found is not None and found.rate_hz is None
    inside = np.zeros(y.size, dtype=bool)
    inside[2_001:2_200] = inside[5_001:5_200] = True
    np.testing.assert_array_equal(found.own, ~inside)


@pytest.mark.parametrize("column", READ)
@pytest.mark.parametrize("zeros", [False, True])
def test_readings_that_others_stand_for_are_lost(column: str, zeros: bool) -> None:
    for seed in range(71_050, 71_053):
        y, rng = move(seed)[column].to_numpy().copy(), np.random.default_rng(seed)
        gone = np.zeros(y.size, dtype=bool)
        for first in rng.choice(y.size // 100, 12, replace=False) * 100:
            part = slice(first, first + int(rng.integers(5, 60)))
            y[part], gone[part] = 0.0 if zeros else y[first], True
        found = lost(y)
        assert found is not None
        assert (found == gone).mean() > 0.999


@pytest.mark.parametrize("name", sorted(TRAITS))
def test_what_loggers_do_loses_no_reading(name: str) -> None:
    frame, _ = make_log_with(name, draw_move_case(71_011, "nominal"), 71_011)
    for column in set(READ) & set(frame):
        assert lost(frame[column].to_numpy(dtype=float)) is None


def test_a_sensor_that_fails_is_seen_whole() -> None:
    """A frozen one, one whose range ends, one with a stuck bit."""
    y = move(71_060)["current_a"].to_numpy().copy()
    frozen = np.where(np.arange(y.size) > 3_000, y[3_000], y)
    for failing in (frozen, np.minimum(y, np.quantile(y, 0.7)), np.floor(y / 2e-3) * 2e-3):
        assert lost(failing) is None


@pytest.mark.parametrize("seed", range(71_070, 71_074))
def test_readings_at_the_end_of_a_range_are_not_taken(seed: int) -> None:
    """Of a range that reaches as far both ways, or ends at zero: all of these, and few others."""
    frame = move(seed)
    for column, share in (("current_a", 0.6), ("voltage_v", 0.7)):
        y = frame[column].to_numpy()
        end = share * np.abs(y).max()
        cut = out_of_range(np.clip(y, -end, end))
        beyond = np.abs(y) >= end
        assert cut is not None and cut[beyond].all() and cut.sum() < beyond.sum() + 60
        assert out_of_range(y) is None
    positive = out_of_range(np.maximum(frame["current_a"].to_numpy(), 0.0))
    assert positive is not None and positive[frame["current_a"] <= 0.0].all()
    clipped = log_from_frame(frame.assign(current_a=frame["current_a"].clip(-0.3, 0.3)))
    assert any("current_a is at the end of its range" in note for note in clipped.notes)


@pytest.mark.parametrize("kind", FAILURES)
def test_a_sensor_that_fails_is_at_no_end_of_its_range(kind: str) -> None:
    for seed, channel in enumerate(CHANNELS, 71_080):
        frame, _ = make_log(draw_failing_case(seed, kind, channel, 3.0), seed)
        assert all(out_of_range(frame[column].to_numpy()) is None for column in READ if column in frame)


def test_it_is_said_of_a_frame_of_a_file_and_of_its_parts(tmp_path: Path) -> None:
    frame = on_other_clocks(move(71_040), (None, None, 100.0), 71_040)
    write_log(frame, tmp_path / "move.csv")
    whole, file = read_log(tmp_path / "move.csv"), open_log(tmp_path / "move.csv")
    parts = list(file.chunks(3_000))
    for notes in (log_from_frame(frame).notes, whole.notes, file.summary.notes):
        assert any(
            "position_m is interpolated between readings, about 100 a second" in note for note in notes
        )
        assert not any("current_a is interpolated" in note for note in notes)
    kept = np.isfinite(np.concatenate([part.z[:, 2] for part in parts]))
    assert kept.sum() == pytest.approx(np.isfinite(whole.z[:, 2]).sum(), abs=2 * len(parts))
