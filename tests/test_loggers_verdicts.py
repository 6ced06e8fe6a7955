"""A verdict depends on the actuator, not on the logger: moves with known faults through loggers as they are."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import pytest
from hidden import PAIRS, TRAITS, TRIPLES, draw_failing_case, draw_move_case, make_log_with, trait_of

from observer_fi.logs import log_from_frame
from observer_fi.physics import load_rig
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose_log

RIG, SETTINGS = load_rig(), Settings()
CLASSES = ("nominal", "overload", "coupling_loss")
FIRST = 7600
CONFIDENT = 0.95
QUICK = {
    "steps_all": "coupling_loss",
    "csv_3_decimals": "overload",
    "position_100hz": "coupling_loss",
    "drive_400hz": "nominal",
    "hum_50hz": "overload",
    "wandering": "nominal",
    "voltage_late": "coupling_loss",
    "spikes": "nominal",
    "missing_rows": "nominal",
}
MISLEADING = ("range_switched", "position_5hz", "position_steps_2mm")
EVERY = (*TRAITS, *PAIRS, *TRIPLES)


class Said(NamedTuple):
    """Whether a verdict was right, and whether it was sure of something else."""

    right: bool
    misled: bool
    words: str


@cache
def said(name: str, label: str, seed: int) -> Said:
    frame, _ = make_log_with(name, draw_move_case(seed, label), seed)
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert outcome.isolation is not None
    verdict = outcome.isolation.verdict
    right = label == verdict.label or label in verdict.alike
    words = f"{name} {label} {seed}: {verdict.label} {verdict.channel or ''} {verdict.probability:.3f}"
    return Said(right, not right and verdict.probability > CONFIDENT, words)


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
@pytest.mark.first(2)
def test_the_verdict_through_a_logger_is_right(name: str) -> None:
    answer = said(name, QUICK[name], FIRST)
    assert answer.right, answer.words


@pytest.mark.first(1)
@pytest.mark.parametrize(("name", "seed"), [("steps_3_all", FIRST), ("twelve_bits", FIRST + 1)])
def test_a_mass_that_never_moves_is_no_coarse_sensor(name: str, seed: int) -> None:
    """Lost before the first step of the position: few of its steps are seen, for the mass stands."""
    spec = draw_move_case(seed, "coupling_loss")
    early = replace(spec, fault=replace(spec.fault, onset_s=spec.profile.moves[0].start_s + 0.01))
    frame, _ = make_log_with(name, early, seed)
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label == "coupling_loss"


# Of 2940 moves on fresh seeds these were wrong: an event of the logger, or a chance of its noise, had been taken for a fault.
ONCE_WRONG = (
    ("drive_off", "nominal", 240006),  # goes off while the motor still rings
    ("drive_off", "nominal", 240018),
    ("mid_move", "coupling_loss", 240011),  # begins while the servo brakes
    ("mid_move", "overload", 240055),
    ("mid_move", "coupling_loss", 240059),
    ("coloured", "nominal", 240048),  # a colour that a filter would give, too
    ("noise_3+steps_all", "nominal", 240054),  # all that a fault of 60 ms gains comes seconds later
    ("position_100hz+steps_all+hum_50hz", "overload", 240022),  # a doubt by chance, 0.35 s before the fault
    # Of loggers that do several things at once, drawn at random.
    (
        "steps_position+wandering",
        "nominal",
        700106,
    ),  # every reading is close to the one before: no frozen sensor
    ("position_100hz+range_switched+low_pass", "overload", 700001),  # another range of a held channel
    ("current_late+milliseconds+missing_rows", "nominal", 700003),  # rounded stamps that look like gaps
    ("drive_400hz+position_50hz+milliseconds", "overload", 740049),  # holds of two rows, 2 ms or 3 ms apart
    ("slow_200hz+wandering", "coupling_loss", 720000),  # rests of 60 samples
    ("slow_200hz+offsets", "nominal", 720001),
    ("slow_200hz+range_switched+position_50hz", "nominal", 900213),  # another range is no motor that settles
    ("slow_200hz+missing_rows", "nominal", 990001),  # few readings are no mean of two
    ("mid_move+steps_current+voltage_late", "nominal", 900360),  # only a stop tells what is late
    ("voltage_late+steps_position+offsets", "nominal", 760261),  # a zero that shows from afar alone
    ("hum_50hz+no_command", "coupling_loss", 900269),  # a recovered command behind hum
    (
        "no_command+drive_off+jitter+offsets",
        "nominal",
        1200174,
    ),  # its command kept an offset that filters lost
    ("no_voltage+voltage_late+mid_move", "coupling_loss", 1100204),  # nobody knows how fast it began
    ("drive_400hz+position_averaged+no_voltage+steps_position", "nominal", 1100106),  # 57 nats of a stop
)


@pytest.mark.parametrize(("name", "label", "seed"), ONCE_WRONG)
@pytest.mark.first(2, 4)
def test_what_a_logger_does_is_no_fault(name: str, label: str, seed: int) -> None:
    answer = said(name, label, seed)
    assert answer.right, answer.words


FAILS_BEHIND = (
    (
        "frozen",
        "voltage",
        "steps_3_all",
        1_700_075,
    ),  # stands within a step, and goes on to as the motor stops
    (
        "frozen",
        "current",
        "twelve_bits",
        1_700_033,
    ),  # the voltage explained the rest as well, and the stop not
)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "channel", "name", "seed"), FAILS_BEHIND)
@pytest.mark.first(1)
def test_a_sensor_that_freezes_behind_coarse_steps_is_named(
    kind: str, channel: str, name: str, seed: int
) -> None:
    frame, _ = make_log_with(name, draw_failing_case(seed, kind, channel, 3.0), seed)
    found = diagnose_log(log_from_frame(frame), RIG, SETTINGS).isolation
    assert found is not None and (found.verdict.label, found.verdict.channel) == ("sensor_fault", channel)


def off_after(monkeypatch: pytest.MonkeyPatch, after_s: float) -> None:
    """The drive goes off so long after a move."""
    trait = TRAITS["drive_off"]._replace(
        apply=lambda acquisition, seed: replace(acquisition, drive_off_s=after_s)
    )
    monkeypatch.setitem(TRAITS, "drive_off", trait)


@pytest.mark.parametrize("other", ["offsets", "drive_400hz", "steps_3_all", "low_pass", "spikes"])
def test_a_drive_that_goes_off_while_the_motor_rings_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    off_after(monkeypatch, 0.03)
    frame, _ = make_log_with(f"drive_off+{other}", draw_move_case(7840, "nominal"), 7840)
    outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
    assert outcome.isolation is not None and outcome.isolation.verdict.label == "nominal"


@pytest.mark.study
@pytest.mark.slow
@pytest.mark.parametrize("after_s", [0.01, 0.03, 0.08])
@pytest.mark.first(1)
def test_a_drive_that_goes_off_at_any_time_of_a_stop_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, after_s: float
) -> None:
    off_after(monkeypatch, after_s)
    for seed in range(7700, 7710):
        frame, _ = make_log_with("drive_off", draw_move_case(seed, "nominal"), seed)
        outcome = diagnose_log(log_from_frame(frame), RIG, SETTINGS)
        assert outcome.isolation is not None and outcome.isolation.verdict.label == "nominal", seed


@pytest.mark.slow
@pytest.mark.study
def test_a_log_that_begins_in_a_start_is_judged() -> None:
    wrong = [
        answer.words
        for seed in range(7720, 7740)
        for answer in (said("mid_move", CLASSES[seed % 3], seed),)
        if not answer.right
    ]
    assert len(wrong) <= 1, wrong


def answers(name: str, turn: int) -> list[Said]:
    """A move of one of the three classes, which one in turn; of all three where sensors mislead."""
    only = None if name in MISLEADING else (EVERY.index(name) + turn) % 3
    return [said(name, label, FIRST + k) for k, label in enumerate(CLASSES) if only in (None, k)]


@pytest.mark.slow
@pytest.mark.parametrize("turn", [1, 2])
@pytest.mark.first(1)
def test_every_logger_and_several_at_once(turn: int) -> None:
    """95 % right where the information is left in; of all others none is sure of something else, but for one."""
    keeping = [answer for name in EVERY if trait_of(name).keeps for answer in answers(name, turn)]
    wrong = [answer.words for answer in keeping if not answer.right]
    assert len(wrong) <= 0.05 * len(keeping), wrong
    misled = [
        answer.words
        for name in EVERY
        if name not in MISLEADING
        for answer in answers(name, turn)
        if answer.misled
    ]
    assert len(misled) <= 1, misled


@pytest.mark.slow
def test_what_a_logger_hides_is_no_certainty() -> None:
    misled = [answer.words for name in MISLEADING for answer in answers(name, 0) if answer.misled]
    assert not misled, misled
