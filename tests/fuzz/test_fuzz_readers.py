"""A few inputs of every fuzz target at each run of the tests; hundreds of thousands by hand."""

import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parent)]
from fuzz_readers import TARGETS, fuzz  # noqa: E402


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.first(6, 7)
def test_mutated_inputs_are_read_or_refused(target: str) -> None:
    outcomes = fuzz(target, 150, seed=7)
    assert not [outcome for outcome in outcomes if outcome.startswith("FIND")], outcomes
    assert outcomes["refused"] + outcomes["listed"] > 20
    assert outcomes["read"] + outcomes["listed"] >= (0 if target == "gz" else 1)
