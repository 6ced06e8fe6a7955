"""How quantities are written: units that keep a number short and are worth the same, digits without an e."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer_fi.numerics.readable_units import digits, readable, size_words, with_error, with_unit


@pytest.mark.parametrize(
    ("unit", "largest", "shown", "factor"),
    [
        ("N m", 3e-4, "µN m", 1e6),
        ("N m", 0.4, "mN m", 1e3),
        ("N m", 4.0, "N m", 1.0),
        ("N m/A", 1e-9, "nN m/A", 1e9),
        ("N m/A", 1e-14, "nN m/A", 1e9),
        ("N m/m^2", 4e4, "kN m/m²", 1e-3),
        ("kg m^2", 4e-7, "kg mm²", 1e6),
        ("m/rad", 1.6e-4, "µm/rad", 1e6),
        ("rad/s", 4e3, "rad/s", 1.0),
        ("rad/s", 4e-2, "rad/s", 1.0),
        ("rad", 4e-2, "mrad", 1e3),
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
    assert with_unit(math.nan, "A") == "– A"
    assert size_words(0.352, "1") == "35.2 %"
    assert size_words(101.4, "N m/m^2") == "101 N m/m²"


def test_an_error_says_how_many_digits_stand() -> None:
    assert with_error(1.49123e-4, 1.2e-6, "N m") == "149.1 ± 1.2 µN m"
    assert with_error(2.0, 0.5, "1") == "2.00 ± 0.50"
    assert with_error(1e-6, 3e-4, "N m") == "0 ± 300 µN m"
    assert with_error(9e-4, 1.3e-7, "m") == "900.00 ± 0.13 µm"
    assert with_error(26.123456, 0.0123, "ohm") == "26.123 ± 0.012 ohm"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(101.4, "101"), (1e2, "100"), (1234.0, "1230"), (0.00049, "0.00049"), (-0.0, "0"), (math.inf, "–"),
     (2.5e-5, "0.000025"), (2.5e-9, "2.5\u00a0×\u00a010⁻⁹"), (1e7, "1\u00a0×\u00a010⁷")],
)  # fmt: skip
def test_digits_without_an_e(value: float, shown: str) -> None:
    assert digits(value) == shown


@given(st.floats(-1e12, 1e12), st.integers(1, 6))
def test_digits_are_the_number(value: float, count: int) -> None:
    text = digits(value, count)
    mantissa, _, power = text.partition("\u00a0×\u00a010")
    back = float(mantissa) * 10.0 ** int(power.translate(str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")) or 0)
    assert back == pytest.approx(float(f"{value:.{count}g}"), rel=1e-9, abs=1e-300)
    assert len(re.sub(r"^-?0?\.?0*|\D", "", mantissa)) <= max(count, 6)


def test_nobody_else_writes_numbers_that_may_get_an_e() -> None:
    """Of what people read; the table that `trend` writes for programs is none of it."""
    package = Path(__file__).parents[2] / "observer_fi"
    rooms = ("cli", "logs", "plan", "report", "serve", "trend", "verdict")
    found = {
        path.name
        for room in rooms
        for path in (package / room).rglob("*.py")
        if re.search(r":[+]?\.[2-5]g\}", path.read_text(encoding="utf-8"))
    }
    pages = {
        p.name for p in package.rglob("*.html") if re.search(r'"%[+]?\.\dg', p.read_text(encoding="utf-8"))
    }
    assert found == {"trend_page.py"} and not pages
