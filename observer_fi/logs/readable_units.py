"""Units in which a number is short: mN m in place of 0.0003 N m."""

import math

# First words of a unit that take a prefix, and the prefixes by their power of ten.
PREFIXED = ("N", "A", "V", "s", "m")
PREFIXES = {-6: "µ", -3: "m", 3: "k"}
SQUARE_MILLIMETRES = -6  # power of ten of kg mm^2 in kg m^2


def readable(unit: str, largest: float) -> tuple[str, float]:
    """The unit in which values up to `largest` (SI) are best read, and the factor to it. No unit stays none."""
    if unit == "1":
        return "", 1.0
    rounded = float(f"{abs(largest):.3g}")  # 999.9 is a thousand
    power = 3 * math.floor(math.log10(rounded) / 3.0) if rounded and math.isfinite(rounded) else 0
    if power == 0:
        return unit, 1.0
    if unit == "kg m^2" and power <= SQUARE_MILLIMETRES:
        return "kg mm^2", 10.0**-SQUARE_MILLIMETRES
    power = max(power, min(PREFIXES))
    if (
        unit.replace("/", " ").split()[0] in PREFIXED
        and power in PREFIXES
        and not (power > 0 and unit[0] in "sm")
    ):
        return f"{PREFIXES[power]}{unit}", 10.0**-power
    return unit, 1.0


def with_unit(value: float, unit: str, sign: str = "") -> str:
    """A value in three digits with the unit in which it is short. sign: "+" for one that is always written."""
    shown, factor = readable(unit, value)
    return f"{factor * value:{sign}.3g} {shown}".rstrip()
