"""How far a search goes on: to hundredths of a nat near the noise, and not in a misfit of thousands."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from observer_fi.learn.gauss_newton import Free, Point, search
from observer_fi.records import Array


@dataclass
class Cubic:
    """Readings that bend: z = a^3 over two moves, with an error of `left` of every reading that no parameter explains."""

    left: float
    free: tuple[Free, ...] = (Free("a", 1e-4),)
    looked: list[float] = field(default_factory=list)

    bounds = np.array([0, 500, 1000])
    nuisance_std = np.ones((2, 2))

    def residuals(self, values: Mapping[str, float], nuisance: Array) -> Array:
        error = np.where(np.arange(1000) % 2, 1.0, -1.0) * self.left
        return np.column_stack([1.0 - values["a"] ** 3 + error, np.zeros(1000), np.zeros(1000)])

    def columns(self, point: Point) -> tuple[Array, Array]:
        self.looked.append(point.values["a"])
        column = np.zeros((1, 1000, 3))
        column[0, :, 0] = 3.0 * point.values["a"] ** 2 * self.free[0].step
        return column, np.zeros((2, 1000, 3))


@pytest.mark.parametrize("left", [1.0, 100.0, 1e4])
def test_a_gross_misfit_is_searched_to_a_share_of_itself(left: float) -> None:
    problem = Cubic(left)
    found = search(problem, {"a": 3.0}, np.zeros((2, 2)))
    misfit = 500.0 * (left**2 - 1.0)
    short = found.point.objective - 500.0 * left**2
    assert found.converged
    assert short < 0.01 + 1e-4 * misfit


def test_near_the_noise_it_goes_on_to_the_end_and_far_from_it_stops_sooner() -> None:
    near, far = Cubic(1.0), Cubic(1e4)
    for problem in (near, far):
        search(problem, {"a": 3.0}, np.zeros((2, 2)))
    assert near.looked[-1] == pytest.approx(1.0, abs=1e-3)
    assert len(far.looked) < len(near.looked)
