"""Warnings: none where there is nothing to say, and each trait's own words with its column and what to change."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hidden import draw_move_case, make_log_with
from logged_signals import SIGMA

from observer_fi.logs import Lateness
from observer_fi.logs.ingest import log_from_frame
from observer_fi.logs.logger.low_pass import LowPass, LowPasses
from observer_fi.logs.logger.means import Mean
from observer_fi.physics.rigs import load_rig
from observer_fi.records import Acquisition, ChannelTraits, Clock, Consistency, Line
from observer_fi.settings import Settings
from observer_fi.verdict.cautions import cautions
from observer_fi.verdict.diagnosis import diagnose_log
from observer_fi.verdict.moves.of_the_day import Day

RIG = load_rig()
NONE, UNFILTERED, USUAL = Lateness(), LowPasses(), Day()
PLAIN = Acquisition(*(ChannelTraits(std, std) for std in SIGMA.tolist()), Clock(0.0, None, 1.0 / 1600.0))


def told(acquisition: Acquisition = PLAIN, late: Lateness = NONE, offset: float = 0.0, nis: float = 2.9,
         label: str = "nominal", low_passes: LowPasses = UNFILTERED, zero: float = 0.0,
         lines: Any = None, day: Day = USUAL, means: tuple[Mean, ...] = (),
         inductance: float = 0.0, filed: Acquisition | None = None) -> tuple[str, ...]:  # fmt: skip
    known: Any = SimpleNamespace(
        rig=RIG, told=acquisition, lateness=late, offset=offset, low_passes=low_passes, zero=zero, lines=lines,
        day=day, means=means, inductance=inductance, filed=filed,
    )  # fmt: skip
    isolation: Any = SimpleNamespace(
        verdict=SimpleNamespace(label=label, reasons=()), consistency=Consistency(nis, 3.0, 0.5)
    )
    return cautions(known, isolation, 1600.0)


def of_position(**fields: object) -> Acquisition:
    return PLAIN._replace(position=PLAIN.position._replace(**fields))


def of_current(**fields: object) -> Acquisition:
    return PLAIN._replace(current=PLAIN.current._replace(**fields))


def test_nothing_is_said_of_an_ideal_logger() -> None:
    assert told() == ()
    assert told(of_current(resolution=3e-4)) == ()  # a step of one sigma hides nothing
    assert told(of_current(noise_std=5e-4, as_white=5e-4)) == ()
    assert told(of_current(spikes=3, lines=(Line(50.0, 1e-4),))) == ()
    assert told(late=Lateness(0.3, 0.3, 0.3)) == told(late=Lateness(0.0, 0.4, 0.0)) == ()
    nan = float("nan")
    assert told(PLAIN._replace(voltage=ChannelTraits(nan, nan))) == ()


WORDS = {
    "held": (of_position(update_hz=100.0), ("position_m is held, fresh 100 times a second", "10 ms late", "log it at 1600 Hz")),
    "coarse": (of_current(resolution=1e-3), ("current_a comes in steps of 1 mA", "finer range or more digits")),
    "hum": (of_current(as_white=2e-3, lines=(Line(150.0, 8e-4), Line(50.0, 2e-3))),
            ("current_a carries periodic disturbances at 50 Hz (2 mA), 150 Hz (800 µA)", "6.7 times", "shield")),
    "colour": (of_position(as_white=5e-5, correlation_s=20e-3), ("position_m has noise that wanders over 20 ms", "5 times")),
    "noise": (of_position(noise_std=3e-5, as_white=3e-5), ("position_m has a noise of 30 µm", "3 times the noise of the rig")),
    "seldom": (of_position(read=0.0125), ("position_m is read in 1.2 % of the rows only", "50 ms late", "log it at 1600 Hz")),
    "mean": (of_position(averaged=32), ("position_m is a mean of the last 32 samples", "20 ms late")),
    "rounded": (PLAIN._replace(clock=Clock(3e-4, 1e-3, 1.25e-3)), ("time_s is rounded to 1 ms", "more digits")),
}  # fmt: skip


@pytest.mark.parametrize("trait", WORDS)
def test_each_trait_is_told_with_what_to_change(trait: str) -> None:
    acquisition, words = WORDS[trait]
    (sentence,) = told(acquisition)
    assert all(part in sentence for part in words), sentence


@pytest.mark.parametrize(
    ("day", "words"),
    [
        (Day(voltage=0.95), "voltage_v reads 5 % less than by the rig file"),
        (Day(winding=1.12), "the winding has 12 % more resistance"),
        (Day(gains=1.2), "the servo has 20 % more gain"),
    ],
)
def test_another_day_is_told(day: Day, words: str) -> None:
    (sentence,) = told(day=day)
    assert sentence.startswith(words)


def test_a_mean_that_was_taken_out_is_told_as_such() -> None:
    (sentence,) = told(of_current(averaged=16), means=(Mean(1, 16, 1e-4, ()),))
    assert sentence.startswith("current_a is a running mean of 16 samples: what it is the mean of was taken")


def test_more_noise_in_motion_is_told() -> None:
    (sentence,) = told(of_current(moving=1.8))
    assert sentence.startswith("the noise of current_a is 1.8 times larger in motion than at rest")


def test_a_filter_is_told_with_what_it_leaves() -> None:
    behind = LowPasses(current=LowPass(30.0, 2))
    (line,) = told(low_passes=behind)
    assert "current_a comes through a low-pass filter of 30 Hz, of order 2: taken out" in line
    noise, line = told(of_current(noise_std=5e-3, as_white=5e-3), low_passes=behind)
    assert "without its filter has a noise of 5 mA" in noise and "low-pass" in line


def test_delays_offsets_and_a_machine_that_is_another_one() -> None:
    (late,) = told(late=Lateness(1.0, 0.0, 0.0))
    assert late.startswith("voltage_v is 625 µs later than the other channels")
    (offset,) = told(offset=-0.05)
    assert offset.startswith("voltage_v reads -50 mV more at rest than current_a explains")
    (model,) = told(nis=30.0)
    assert "squared 30, 3 expected" in model and "Identify the rig" in model
    assert told(nis=30.0, label="not_tested") == ()


def test_what_was_taken_out_is_told_as_such() -> None:
    hummed = of_current(lines=(Line(50.0, 2e-3),), as_white=3e-4)
    lines: Any = SimpleNamespace(channels=[SimpleNamespace(hz=np.full(n, 50.0)) for n in (0, 1, 0)])
    (said,) = told(hummed, lines=lines)
    assert "current_a carries periodic disturbances at 50 Hz (2 mA): taken out" in said
    (said,) = told(zero=-2e-3)
    assert "current_a is -2 mA off its zero" in said and "zero the sensor" in said


def test_a_noise_that_the_rig_was_learned_through_is_no_news() -> None:
    """Nobody was ever told that the logger of a data sheet's guess has its noise; a louder day is told all the same."""
    loud = of_current(noise_std=1.5e-3, as_white=1.5e-3)
    assert len(told(loud)) == 1 and told(loud, filed=loud) == ()
    (said,) = told(of_current(noise_std=6e-3, as_white=6e-3), filed=loud)
    assert said.startswith("current_a has a noise of 6 mA")


def test_several_are_all_told_by_channel() -> None:
    both = of_position(update_hz=100.0)._replace(
        current=PLAIN.current._replace(as_white=1e-3, noise_std=1e-3)
    )
    assert [sentence.split()[0] for sentence in told(both)] == ["current_a", "position_m"]


def warned(name: str, label: str, seed: int) -> tuple[str, ...]:
    frame, _ = make_log_with(name, draw_move_case(seed, label), seed)
    return diagnose_log(log_from_frame(frame), RIG, Settings()).warnings


@pytest.mark.parametrize("label", ["nominal", "overload", "coupling_loss"])
@pytest.mark.first(1)
def test_an_ideal_log_has_no_warnings(label: str) -> None:
    assert all(warned("ideal", label, seed) == () for seed in (7610, 7611))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("noise_3", "has a noise of"),
        ("steps_3_all", "comes in steps of"),
        ("position_100hz", "position_m is held, fresh 100 times a second"),
        ("hum_50hz", "carries periodic disturbances at"),
        ("wandering", "has noise that wanders over"),
        ("position_averaged", "is a mean of the last 32 samples"),
        ("milliseconds", "time_s is rounded to 1 ms"),
        ("voltage_late", "later than the other channels"),
    ],
)
@pytest.mark.first(4)
def test_what_a_logger_hides_is_told_with_the_verdict(name: str, words: str) -> None:
    assert any(words in sentence for sentence in warned(name, "nominal", 7612))


def test_an_inductance_that_was_taken_out_is_told() -> None:
    assert any("1.4 mH in the winding" in warning for warning in told(inductance=1.4e-3))
