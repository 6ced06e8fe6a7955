"""Hostile logs through every reader: one line, or every repair listed; and no row of any file is ever lost."""

import re
from pathlib import Path

import numpy as np
import pytest
from hostile_logs import HOSTILE
from scenarios import Scenario

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import load_columns
from observer_fi.logs.ingest import open_log

CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202e\ud800-\udfff]")


def test_there_are_enough_of_them() -> None:
    names = [scenario.name for scenario in HOSTILE]
    assert len(names) == len(set(names)) >= 150


@pytest.mark.parametrize("scenario", HOSTILE, ids=lambda s: s.name)
def test_a_hostile_log_is_one_line_or_a_listed_repair(scenario: Scenario, tmp_path: Path, capfd) -> None:
    path, map_path = scenario.write(tmp_path), scenario.column_map(tmp_path)
    column_map = load_columns(map_path) if map_path else None
    if scenario.error:
        with pytest.raises(InvalidLogError) as caught:
            list(open_log(path, column_map).chunks())
        message = str(caught.value)
        assert re.search(scenario.error, message), message
        assert not CONTROLS.search(message) and len(message) <= 2000
    else:
        file = open_log(path, column_map)
        logs = list(file.chunks(1000))
        said = (file.summary.notes, file.summary.rejected[:9])
        assert file.summary.rejected_count == scenario.rejected, said
        assert scenario.samples in (None, file.summary.samples), said
        assert file.summary.gap_count >= scenario.gaps, said
        for wanted in scenario.notes:
            assert any(wanted in note for note in file.summary.notes), said
        assert not any(map(CONTROLS.search, (*file.metadata, *file.summary.notes)))
        assert sum(map(len, file.metadata)) < 200_000
        assert all(np.all(np.diff(log.t) > 0.0) for log in logs)
    assert capfd.readouterr() == ("", "")  # a reader of others writes nothing to the terminal
