"""The search against every profile there is, where there are few."""

from itertools import product

import numpy as np

from observer_fi.plan.search import best_counts, best_repeated, chosen


def information(counts):
    """Two directions that only different blocks show: the least of them counts."""
    shows = np.array([[3.0, 0.0], [0.0, 2.0], [1.0, 1.0], [0.2, 0.1]])
    return float((counts @ shows).min())


SECONDS = np.array([2.0, 1.5, 3.0, 0.5])


def test_it_comes_close_to_the_best_there_is():
    all_counts = [np.array(c, dtype=float) for c in product(range(6), range(7), range(4), range(20))]
    best = max(information(c) for c in all_counts if c @ SECONDS <= 10.0)
    found = best_counts(information, SECONDS, 10.0)
    assert found @ SECONDS <= 10.0
    assert information(found) >= 0.9 * best


def test_one_block_repeated_is_the_best_one():
    found = best_repeated(information, SECONDS, 10.0)
    assert found.tolist() == [0.0, 0.0, 3.0, 0.0]


def test_nothing_fits_into_no_time():
    assert not best_counts(information, SECONDS, 0.1).any()
    assert not best_repeated(information, SECONDS, 0.1).any()


def test_chosen_blocks_stand_as_often_as_counted():
    assert chosen(np.array([2.0, 0.0, 1.0, 0.0]), "abcd") == ("a", "a", "c")
