"""Units that keep a number short, and worth the same."""

import pytest

from observer_fi.logs.readable_units import readable, with_unit


@pytest.mark.parametrize(
    ("unit", "largest", "shown", "factor"),
    [
        ("N m", 3e-4, "µN m", 1e6),
        ("N m", 0.4, "mN m", 1e3),
        ("N m", 4.0, "N m", 1.0),
        ("N m/A", 1e-9, "µN m/A", 1e6),
        ("kg m^2", 4e-7, "kg mm^2", 1e6),
        ("m/rad", 1.6e-4, "µm/rad", 1e6),
        ("s", 4e3, "s", 1.0),
        ("1/s", 1e-3, "1/s", 1.0),
        ("1", 1e-5, "", 1.0),
        ("A", 0.0, "A", 1.0),
        ("A", float("nan"), "A", 1.0),
    ],
)
def test_a_unit_is_chosen_by_the_largest_value(unit: str, largest: float, shown: str, factor: float) -> None:
    found, by = readable(unit, largest)
    assert found == shown and by == pytest.approx(factor)


def test_a_value_in_words() -> None:
    assert with_unit(3.456e-4, "N m") == "346 µN m"
    assert with_unit(0.25, "1") == "0.25"
    assert with_unit(9.49e-5, "m", "+") == "+94.9 µm"
    assert with_unit(-0.9999999, "A") == "-1 A"
