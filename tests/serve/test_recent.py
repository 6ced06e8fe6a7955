"""The last samples of a stream: what was put in comes out, however it came, and no more than there is room for is kept."""

import numpy as np
import pytest

from observer_fi.bank import HypothesisState, LogSamples
from observer_fi.serve.recent import EVERY, KEPT, Recent

RATE = 1600.0
NO_MEMORY = HypothesisState(*(np.empty(0) for _ in HypothesisState._fields))


def samples(first: int, n: int) -> LogSamples:
    k = np.arange(first, first + n)
    one = k.astype(float)
    return LogSamples(
        k / RATE, np.column_stack((one, -one)), one, one, np.column_stack((one,) * 3), k % 2 == 0
    )


@pytest.mark.parametrize("batch", [1, 7, 1000])
def test_what_was_put_in_comes_out(batch: int) -> None:
    ring, total = Recent(1, 1000), 3 * KEPT
    for first in range(0, total, batch):
        n = min(batch, total - first)
        if ring.until_memory() < n:
            at = first + ring.until_memory()
            ring.remember(at / RATE, NO_MEMORY._replace(z=np.array([float(at)])))
        ring.add(samples(first, n))
    wanted = total - KEPT // 2
    found = ring.between(wanted / RATE, (total - 100) / RATE)
    assert found is not None
    window, memory = found
    begin = int(memory.z[0])
    assert begin % EVERY == 0 and begin <= wanted
    expected = samples(begin, total - 100 - begin + 1)
    for have, want in zip(window, expected, strict=True):
        assert np.array_equal(have, want)


def test_what_is_gone_is_none() -> None:
    ring = Recent(1, 1000)
    assert ring.between(0.0, 1.0) is None
    for first in range(0, 4 * KEPT, 1000):
        ring.remember(first / RATE, NO_MEMORY)
        ring.add(samples(first, 1000))
    assert ring.between(0.0, 1.0) is None
    assert ring.count <= ring.rows.t.size
