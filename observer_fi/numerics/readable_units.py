"""How a quantity is written for people: three significant digits, and the unit in which they are short.

One way for terminal, pages and figures; files for programs keep SI. mN m in place of 0.0003 N m, 1,200 never as 1.2e+03.
"""

import math

# First words of a unit that take a prefix, and the prefixes by their power of ten.
PREFIXED = ("N", "A", "V", "s", "m", "Hz", "J", "W", "rad")
PREFIXES = {-9: "n", -6: "µ", -3: "m", 3: "k", 6: "M"}
SQUARE_MILLIMETRES = -6  # power of ten of kg mm^2 in kg m^2
_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_WHOLE, _SMALL = 1e6, 1e-5  # from here on, and below, powers of ten are shorter than zeros


def digits(value: float, count: int = 3, sign: str = "") -> str:
    """A number in `count` significant digits, without an e. sign: "+" for one that is always written. NaN is a dash."""
    if not math.isfinite(value):
        return "–"
    rounded = float(f"{value:.{count}g}") + 0.0  # -0 is 0
    if rounded and not _SMALL <= abs(rounded) < _WHOLE:
        mantissa, _, power = f"{value:{sign}.{count - 1}e}".partition("e")
        short = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
        return f"{short}\u00a0×\u00a010{str(int(power)).translate(_POWERS)}"
    places = max(0, count - 1 - math.floor(math.log10(abs(rounded)))) if rounded else 0
    text = f"{rounded:{sign}.{places}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def readable(unit: str, largest: float) -> tuple[str, float]:
    """The unit in which values up to `largest` (SI) are best read, and the factor to it. No unit stays none."""
    if unit in ("", "1"):
        return "", 1.0
    rounded = float(f"{abs(largest):.3g}")  # 999.9 is a thousand
    power = 3 * math.floor(math.log10(rounded) / 3.0) if rounded and math.isfinite(rounded) else 0
    written = unit.replace("^2", "²").replace("^3", "³")
    if unit == "kg m^2" and power <= SQUARE_MILLIMETRES:
        return "kg mm²", 10.0**-SQUARE_MILLIMETRES
    power = min(max(power, min(PREFIXES)), max(PREFIXES))
    first = unit.replace("/", " ").split()[0]
    named = first in PREFIXED and (first != "rad" or unit == "rad")  # 0.5 rad/s, no 500 mrad/s
    if power and named and not (power > 0 and first in ("s", "m", "rad")):
        return f"{PREFIXES[power]}{written}", 10.0**-power
    return written, 1.0


def readable_share(unit: str, largest: float) -> tuple[str, float]:
    """As `readable`, where a number without a unit is a share: in per cent."""
    return ("%", 100.0) if unit == "1" else readable(unit, largest)


def with_unit(value: float, unit: str, sign: str = "", count: int = 3) -> str:
    """A value in `count` digits with the unit in which it is short. sign: "+" for one that is always written."""
    shown, factor = readable(unit, value)
    return f"{digits(factor * value, count, sign)} {shown}".rstrip()


def size_words(value: float, unit: str) -> str:
    """How large a fault is: a share in per cent, else a value with its unit."""
    shown, factor = readable_share(unit, value)
    return f"{digits(factor * value)} {shown}"


def with_error(value: float, std: float, unit: str) -> str:
    """A value ± its standard error, in the unit in which both are short; as many digits as the error lets stand."""
    shown, factor = readable(unit, value if abs(value) > abs(std) or not math.isfinite(std) else std)
    return f"{to_the_error(factor * value, factor * std)} ± {to_the_error(factor * std, factor * std)} {shown}".rstrip()


def to_the_error(value: float, std: float) -> str:
    """A value to the second digit of its standard error, zeros at its end too."""
    rounded = float(f"{std:.2g}") if math.isfinite(std) else 0.0
    if not math.isfinite(value) or not rounded or abs(value) >= _WHOLE:
        return digits(value, 4)
    places = 1 - math.floor(math.log10(abs(rounded)))
    return f"{round(value, places) + 0.0:.{min(max(places, 0), 6)}f}"
