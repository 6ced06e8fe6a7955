"""The study of `pipelines/diagnose_study.py`: a small one in `make slow`, a large one in `make studies`. Independent truth."""

import numpy as np
import pandas as pd
import pytest

from pipelines import diagnose_study as d

SMALL = 6  # moves of each class


@pytest.fixture(scope="module")
def few() -> pd.DataFrame:
    return d.study(d.jobs(d.NAMED, SMALL))


@pytest.mark.slow
def test_every_move_is_right(few: pd.DataFrame) -> None:
    assert few["right"].all(), d.wrong(few)
    assert not (few["isolated_ms"] < 0.0).any()


@pytest.mark.slow
def test_moves_are_isolated_fast_and_placed_well(few: pd.DataFrame) -> None:
    """The medians asked of 300 moves (50 and 10 ms), with room for few: a quarter of all coupling losses take over 10 ms."""
    for label, delay_ms in (("overload", 50.0), ("coupling_loss", 15.0)):
        g = few[few["label"] == label]
        assert g["isolated_ms"].median() < delay_ms
        assert g["found_ms"].abs().median() < 15.0


@pytest.mark.slow
def test_moves_are_consistent(few: pd.DataFrame) -> None:
    assert few["nis"].between(2.7, 3.2).all()  # 3 expected, less what starts leave in doubt


@pytest.mark.slow
@pytest.mark.study
def test_the_report_holds_every_table(few: pd.DataFrame) -> None:
    other = d.study(d.jobs(d.OTHER, 1))
    off = d.study(d.jobs(d.NAMED[:1], 1, (2.0,)))
    free = d.study(d.jobs(d.NAMED, 1, drive="voltage"))
    assert free["right"].all()
    plain = d.without_doubt(d.jobs(d.NAMED, 1))
    assert plain.index.tolist() == list(d.NAMED) and plain["moves"].tolist() == [1] * 3
    text = d.report(few, other, off, free, d.calibration([d.Job("coupling_loss", d.FIRST_SEED)]), plain)
    assert [line for line in text.splitlines() if line.startswith("## ")] == [
        "## Nominal, overload, coupling loss",
        "## What the constants in doubt are for",
        "## Sensor faults and faults outside the named classes",
        "## Calibration",
        "## Consistency",
        "## A rig file that is off",
        "## A servo that nobody knows",
        "## Every wrong verdict",
    ]
    assert text.isascii() and f"False alarms on healthy moves: 0 of {SMALL}" in text


def test_a_job_is_repeated_by_its_seed() -> None:
    one, two, other = (
        d.spec_of(d.Job("overload", 7, 2.0)),
        d.spec_of(d.Job("overload", 7, 2.0)),
        d.spec_of(d.Job("overload", 7)),
    )
    assert one == two != other
    assert other.rig.J == 4.7e-7 != one.rig.J
    assert one.fault == other.fault


def test_declared_alike_is_accepted_and_nothing_else() -> None:
    row = pd.DataFrame(
        [
            {
                "label": "unknown",
                "kind": "resistance_jump",
                "channel": None,
                "said": "sensor_fault",
                "said_channel": "voltage",
            }
        ]
    )
    accepted = {
        (said, channel): d.acceptable(next(row.assign(said=said, said_channel=channel).itertuples()))
        for said, channel in (
            ("sensor_fault", "voltage"),
            ("sensor_fault", "current"),
            ("unknown", None),
            ("overload", None),
        )
    }
    assert list(accepted.values()) == [True, False, True, False]


# --- the study -----------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[25, 50])
def many(request: pytest.FixtureRequest) -> pd.DataFrame:
    """So many moves of each fault, and twice as many healthy ones."""
    return d.study([*d.jobs(d.NAMED[:1], 2 * request.param), *d.jobs(d.NAMED[1:], request.param)])


@pytest.mark.slow
@pytest.mark.study
def test_many_moves(many: pd.DataFrame) -> None:
    """Must show of the bank: 99 % right at the end of the log, medians of delay and onset, no false alarm.

    The report counts four hundred.
    """
    assert many["right"].mean() >= 0.99, d.wrong(many)
    assert many[many["label"] == "nominal"]["right"].all()
    for label, delay_ms in (("overload", 50.0), ("coupling_loss", 10.0)):
        g = many[many["label"] == label]
        assert g["right"].mean() >= 0.98
        assert g["isolated_ms"].median() <= delay_ms and g["found_ms"].abs().median() <= 15.0
        assert not (g["isolated_ms"] < 0.0).any()
        # A coupling that let go within a start and leaves voltage and current as they were is shared with a failed position.
        shared = g["isolated_ms"].isna()
        assert shared.mean() <= 0.1 and (g["probability"][shared] == 0.5).all()
        # 95 % intervals: 3 standard deviations of a share
        assert g["covered"].mean() >= 0.95 - 3.0 * np.sqrt(0.05 * 0.95 / len(g))


@pytest.mark.slow
@pytest.mark.study
def test_innovations_are_consistent(many: pd.DataFrame) -> None:
    assert many["nis"].mean() == pytest.approx(2.95, abs=0.1)
    assert (many["whiteness_p"] < 0.01).mean() < 0.1
    assert many["whiteness_p"].median() > 0.2


@pytest.mark.slow
def test_probabilities_are_calibrated() -> None:
    """Of samples with a stated probability, that share is right: within 4 of its own standard deviations of moves."""
    table = d.calibration(d.jobs(d.NAMED, 25))
    for row in table.itertuples():
        spread = np.sqrt(
            row._2 * (1.0 - row._2) / max(row.samples / 10.0, 1.0)
        )  # samples of a move are alike
        assert abs(row._2 - row._3) < 4.0 * spread + 0.01, table


@pytest.mark.slow
@pytest.mark.study
@pytest.mark.parametrize("moves", [2, 6, 16])
def test_what_is_outside_the_named_classes_is_not_taken_for_one_of_them(moves: int) -> None:
    other = d.study(d.jobs(d.OTHER, moves))
    seen = other[~other["kind"].isin(d.NOT_SEEN)]
    assert (seen["said"] != "nominal").mean() >= 0.99
    assert seen["said"].isin(["sensor_fault", "unknown", "slip", "jam"]).mean() >= 0.9


@pytest.mark.slow
@pytest.mark.study
def test_a_rig_file_two_percent_off_changes_nothing_much() -> None:
    off = d.study(d.jobs(d.NAMED, 15, (2.0,)))
    assert off["right"].mean() >= 0.97, d.wrong(off)
