"""The table of faults: every row is whole, its words reach the page, and a broken row is an error when it is made."""

from dataclasses import fields, replace
from typing import Any

import pytest

from observer_fi.physics import equations as a
from observer_fi.physics.fault_row import NOMINAL, UNKNOWN, FaultRow, Injection, table
from observer_fi.physics.faults import (
    FAULT_KINDS,
    FAULTS,
    LABELS,
    OPEN_LOOP,
    broken,
    channel_of,
    colour_of,
    faulty,
    label_of,
    mode_of,
    words_of,
)
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.sheets.derived import PRESSED_M
from observer_fi.records import CHANNELS, Consistency, Event, Isolation, Log
from observer_fi.report import diagnosis as report
from observer_fi.verdict.explain import explanation

RIG = load_rig()
PLANT = RIG.model
ROWS = tuple(FAULTS.values())


def test_a_row_has_no_defaults_so_a_forgotten_column_fails_at_import() -> None:
    columns = {f.name: getattr(FAULTS["overload"], f.name) for f in fields(FaultRow)}
    for name in columns:
        with pytest.raises(TypeError, match=name):
            FaultRow(**{k: v for k, v in columns.items() if k != name})  # type: ignore[arg-type]


@pytest.mark.parametrize(("changes", "what"), [
    ({"happened": ""}, "happened"),
    ({"action": "  "}, "action"),
    ({"title": "Stuck {channel}"}, "title"),
    ({"plant": {"cuopling": 0.0}}, "cuopling"),
    ({"shares": ("friction",)}, "friction"),
    ({"made_by": {"bent": Injection(("bend",), 1.0)}}, "bend"),
    ({"colours": ("red",)}, "red"),
    ({"colours": ("#d55e00", "#d55e00")}, "one colour each"),
    ({"by_channel": True}, "one colour each"),
])  # fmt: skip
def test_a_broken_row_is_refused(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(ValueError, match=what):
        replace(FAULTS["overload"], **changes)


@pytest.mark.parametrize("rows", [
    (*ROWS, ROWS[1]),
    (*ROWS[:-1], replace(ROWS[-1], rank=ROWS[0].rank)),
    (*ROWS[:-1], replace(ROWS[-1], made_by=ROWS[1].made_by)),
    ROWS[1:],
    tuple(row for row in ROWS if row.label != UNKNOWN),
])  # fmt: skip
def test_a_table_that_cannot_be_is_refused(rows: tuple[FaultRow, ...]) -> None:
    with pytest.raises(ValueError, match="fault"):
        table(*rows)
    assert list(table(*ROWS)) == list(LABELS)


def test_the_labels_of_the_contract() -> None:
    assert set(LABELS) == {"nominal", "overload", "coupling_loss", "slip", "jam", "sensor_fault", "unknown"}
    assert OPEN_LOOP == ("nominal", "overload", "coupling_loss")  # the paper's three models


def test_a_mode_is_a_label_and_perhaps_a_channel() -> None:
    modes = [mode for row in ROWS for mode in row.modes]
    assert len(modes) == len(LABELS) - 1 + len(CHANNELS)
    for mode in modes:
        assert mode_of(label_of(mode), channel_of(mode)) == mode
    assert (label_of("sensor:current"), channel_of("sensor:current")) == ("sensor_fault", "current")
    assert (
        words_of("sensor:current") == "current sensor fault" and words_of("coupling_loss") == "coupling loss"
    )


def test_colours_tell_hypotheses_apart() -> None:
    modes = [mode for row in ROWS for mode in row.modes]
    assert len({colour_of(mode) for mode in modes}) == len(modes)
    assert colour_of("sensor_fault", "current") == colour_of("sensor:current")
    assert colour_of("sensor_fault") in FAULTS["sensor_fault"].colours  # a whole label, as in a fleet's list


def test_a_fault_changes_nothing_else_of_the_plant() -> None:
    for row in ROWS:
        model = faulty(PLANT, row.label)
        assert {n: model[n] for n in a.NAMES if model[n] != PLANT[n]} == dict(row.plant)


def test_a_stop_stands_where_the_mass_is_in_the_direction_of_its_motion() -> None:
    ahead, behind = (broken(PLANT, "overload", 3e-3, forwards) for forwards in (True, False))
    assert (ahead["x_stop_high"], ahead["x_stop_low"]) == (3e-3, PLANT["x_stop_low"])
    assert (behind["x_stop_high"], behind["x_stop_low"]) == (PLANT["x_stop_high"], 3e-3)
    assert broken(PLANT, "winding", 0.0, True)["Rm"] == FAULT_KINDS["winding"].made_by["winding"].size
    assert broken(PLANT, "winding", 0.0, True, size=30.0)["Rm"] == 30.0


def test_every_kind_of_synthetic_fault_changes_the_plant_or_a_sensor() -> None:
    for kind, row in FAULT_KINDS.items():
        made = row.made_by[kind]
        assert bool(made.parameters) == (not row.by_channel and kind != "none"), kind
        assert len(made.sizes) in (0, len(CHANNELS))


@pytest.mark.parametrize("row", ROWS, ids=LABELS)
def test_the_words_of_a_row_reach_the_reader(row: FaultRow) -> None:
    """Explanation, headline, list of doubts and the names of a page: none has words of its own."""
    channel = "position" if row.by_channel else None
    event = Event(
        row.label, channel, 0.97, 1.0, (0.99, 1.01), 1.0, 1.1, 0.3, 2.0, dict.fromkeys(LABELS, 0.0) | {row.label: 0.97}
    )  # fmt: skip
    isolation = Isolation(event, (event,), Consistency(3.0, 3.0, 0.5))
    log = Log("x.csv", *[RIG.noise_std] * 4)
    text = explanation(isolation, RIG, log)
    for sentence in (row.happened, row.action, row.alike.get(channel, ""), row.caveat(PLANT)):
        assert sentence.format(channel=channel) in text
    assert "{" not in text
    assert report.NAMES[row.label] == row.title


def test_a_lost_coupling_has_a_blind_spot_that_depends_on_the_rig() -> None:
    angle = (PLANT["A_decoupled"] - PLANT["A"]) / PLANT["B"]
    assert f"{angle:.1f} deg" in FAULTS["coupling_loss"].caveat(PLANT)
    assert all(row.caveat(PLANT) == "" for row in ROWS if row.label != "coupling_loss")
    assert FAULTS[NOMINAL].rank > max(row.rank for row in ROWS if row.label != NOMINAL)


@pytest.mark.parametrize("pressed_m", [10e-3, 24e-3, 40e-3])
def test_a_bumper_of_a_long_travel_is_an_obstacle(pressed_m: float) -> None:
    """Pressed by 24 mm (a rig file guesses 2 mm) it was no believable stiffness: a slip with a jam behind it, for sure."""
    stiffness = next(own for own in FAULTS["overload"].sizes if own.name == "C")
    assert stiffness.low <= (PRESSED_M / pressed_m) ** 2
