"""plain_lines: the numbers of `float`, or nothing at all."""

from fractions import Fraction

import numpy as np
import pytest

from observer_fi.logs.plain_lines import numbers


def read_by_float(block: bytes, separator: str, used: tuple[int, ...]) -> np.ndarray:
    rows = [line.split(separator) for line in block.decode().split("\n") if line.strip()]
    return np.array([[float(row[k]) if row[k] else np.nan for k in used] for row in rows])


@pytest.mark.parametrize(
    "form", [repr, "{:.7g}".format, "{:+.6e}".format, "{:.20f}".format, "{:.25g}".format]
)
def test_every_double_is_that_of_float(form: object) -> None:
    rng = np.random.default_rng(1)
    bits = rng.integers(0, 1 << 64, 30_000, dtype=np.uint64).view(np.float64)
    values = np.concatenate((bits, rng.normal(size=30_000), [5e-324, 1.7976931348623157e308, -0.0, 0.1]))
    block = "".join(f"{form(float(v))},{k}\n" for k, v in enumerate(values)).encode()  # type: ignore[operator]
    found, expected = numbers(block, ",", ".", 2, (0, 1)), read_by_float(block, ",", (0, 1))
    assert found is not None
    known = values == values
    assert np.array_equal(found[known].view(np.uint64), expected[known].view(np.uint64))
    assert np.isnan(found[~known, 0]).all()


def test_half_way_between_two_doubles_is_rounded_as_float_does() -> None:
    rng = np.random.default_rng(2)
    low = np.abs(rng.normal(size=2000))
    halves = [(Fraction(a) + Fraction(b)) / 2 for a, b in zip(low, np.nextafter(low, 9.0), strict=True)]
    texts = [f"{half.numerator * 10**70 // half.denominator}e-70" for half in halves]
    block = "".join(f"{text}\n" for text in [*texts, *(t.replace("e", "1e") for t in texts)]).encode()
    found = numbers(block, ",", ".", 1, (0,))
    assert found is not None and np.array_equal(found, read_by_float(block, ",", (0,)))


PLAIN = (
    "1.",
    ".5",
    "+1.5",
    "1E+5",
    "-nan",
    "NaN",
    "inf",
    "-Infinity",
    " 1.5 ",
    "\t2",
    "00012",
    "1e400",
    "1e-400",
    "",
)
STRANGE = (
    "nan(1)",
    '"3"',
    "1_0",
    "1,2",
    "1d5",
    "0x1",
    "1e",
    "-",
    "x",
    "1\r2",
    "  ",
    "1 2",
    "1\x00",
    "²",
    "\x0c3",
)


@pytest.mark.parametrize("text", PLAIN)
def test_what_float_takes(text: str) -> None:
    found = numbers(f"0;{text};a\r\n\r\n1;2;b\r\n".encode(), ";", ".", 3, (1,))
    assert found is not None
    assert np.array_equal(found[:, 0], [float(text) if text else np.nan, 2.0], equal_nan=True)


@pytest.mark.parametrize("text", STRANGE)
def test_anything_else_is_left_to_others(text: str) -> None:
    """Also what `float` would take ("\\x0c3"): a block that is refused is only slower."""
    assert numbers(f"0,{text}\n1,2\n".encode(), ",", ".", 2, (1,)) is None


@pytest.mark.parametrize(
    "block, separator",
    [
        (b"1,2\n3\n", ","),
        (b"1,2\n3,4,5\n", ","),
        (b"\n\n", ","),
        (b"1e2\n", "e"),
        (b"1\t\n", "\t"),
        (b"\t1\n", "\t"),
        (b"1\t2\n3\t\r\n", "\t"),
        (b"#1,2\n", ","),
    ],
)
def test_no_table(block: bytes, separator: str) -> None:
    assert numbers(block, separator, ".", 2, (0, 1)) is None


def test_decimal_commas() -> None:
    texts = ["0,1", "-1234,5678901234567", "7", "1,5e-3", ""]
    block = "".join(f"{text};0\n" for text in texts).encode()
    found = numbers(block, ";", ",", 2, (0,))
    assert found is not None
    expected = [float(text.replace(",", ".")) if text else np.nan for text in texts]
    assert np.array_equal(found[:, 0], expected, equal_nan=True)
    assert numbers(block, ";", ".", 2, (0,)) is None and numbers(b"1.5;2\n", ";", ",", 2, (0,)) is None
