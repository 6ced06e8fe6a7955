"""Values as data sheets print them: a number, a unit, in SI. A small table: what is not in it is refused with what is."""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from observer_fi.errors import UsageError

_RPM = math.pi / 30.0
_GRAVITY = 9.80665
_INCH, _POUND, _OUNCE = 0.0254, 0.45359237, 0.028349523125


class Kind(NamedTuple):
    """What is printed: an example, units with their factors to SI, least and largest value that an actuator has (SI).

    own: the factor of a number without a unit, None where it needs one; said: the unit that it is then told to have, "" where
    there is no other.
    """

    example: str
    units: Mapping[str, float]
    least: float
    most: float
    own: float | None = None
    said: str = ""


def _kind(
    example: str, units: dict[str, float], least: float, most: float, own: float | None = None, said: str = ""
) -> Kind:
    return Kind(example, MappingProxyType(units), least, most, own, said)


_CURRENT = {"A": 1.0, "mA": 1e-3}
_TORQUE = {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6, "Ncm": 1e-2, "ozin": _OUNCE * _GRAVITY * _INCH,
           "lbin": _POUND * _GRAVITY * _INCH, "gcm": 1e-5 * _GRAVITY, "kgcm": 1e-2 * _GRAVITY}  # fmt: skip
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH, "ft": 12.0 * _INCH}
_MASS = {"kg": 1.0, "g": 1e-3, "t": 1e3, "lb": _POUND, "oz": _OUNCE}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": _POUND * _GRAVITY, "kgf": _GRAVITY}
_SPEED = {"rad/s": 1.0, "rpm": _RPM, "rev/s": 60.0 * _RPM}
_ACCELERATION = {"rad/s2": 1.0, "rpm/s": _RPM, "rev/s2": 60.0 * _RPM}

KINDS: Mapping[str, Kind] = MappingProxyType({
    "resistance": _kind("2.3 ohm", {"ohm": 1.0, "mohm": 1e-3, "kohm": 1e3}, 1e-4, 1e5, 1.0),
    "inductance": _kind("0.6 mH", {"H": 1.0, "mH": 1e-3, "uH": 1e-6}, 1e-9, 1e2),
    "torque_constant": _kind("17.5 mNm/A", {f"{t}/A": f for t, f in _TORQUE.items()}, 1e-6, 1e2, 1.0, "Nm/A"),
    "speed_constant": _kind("184 rpm/V", {f"{s}/V": f for s, f in _SPEED.items()}, 1e-2, 1e6),
    "back_emf": _kind(
        "5.4 V/krpm",
        {"V/krpm": 1e-3 / _RPM, "mV/rpm": 1e-3 / _RPM, "V/rpm": 1.0 / _RPM, "Vs/rad": 1.0, "mVs/rad": 1e-3},
        1e-6, 1e2,
    ),
    "inertia": _kind(
        "520 gcm2",
        {"kgm2": 1.0, "kgcm2": 1e-4, "kgmm2": 1e-6, "gm2": 1e-3, "gcm2": 1e-7, "gmm2": 1e-9,
         "ozins2": _OUNCE * _GRAVITY * _INCH, "lbins2": _POUND * _GRAVITY * _INCH, "ozin2": _OUNCE * _INCH**2,
         "lbin2": _POUND * _INCH**2},
        1e-12, 1e2, 1.0, "kgm2",
    ),
    "gear": _kind("14:1", {":1": 1.0}, 1e-2, 1e5, 1.0),
    "efficiency": _kind("80 %", {"%": 0.01}, 0.01, 1.0, 1.0),
    "lead": _kind("4 mm", _LENGTH | {"mm/rev": 1e-3, "mm/turn": 1e-3}, 1e-6, 1.0, 1.0, "m"),
    "mass": _kind("6 kg", _MASS, 1e-6, 1e5, 1.0),
    "travel": _kind("500 mm", _LENGTH, 1e-5, 1e2, 1.0, "m"),
    "voltage": _kind("24 V", {"V": 1.0, "mV": 1e-3, "kV": 1e3}, 1e-2, 1e4, 1.0),
    "current": _kind("1.2 A", _CURRENT, 1e-6, 1e4, 1.0),
    "force": _kind("25 N", _FORCE, 1e-6, 1e7, 1.0),
    "speed": _kind("4400 rpm", _SPEED, 1e-2, 1e6),
    "acceleration": _kind("6e4 rad/s2", _ACCELERATION, 1e-2, 1e9, 1.0, "rad/s2"),
})  # fmt: skip

# What is printed in more than one way. A point, a cross or a space between two units says nothing.
_SYMBOLS = str.maketrans({
    "²": "2", "³": "3", "µ": "u", "\u03bc": "u", "\u03a9": "ohm", "\u2126": "ohm", "⁻": "-", "¹": "1", "\u2212": "-", "·": "",
    "⋅": "", "\u00d7": "", "*": "", "^": "", " ": "", "\u00a0": "", "\u202f": "", "\u2009": "",
})  # fmt: skip
_NAMES = (
    (r"[oO]hms?\b", "ohm"),
    (r"\((.*?)\)", r"\1"),
    (r"(1/min|min-1|U/min|r/min|rev/min|RPM|upm)", "rpm"),
    (r"^krpm/V", "krpm/V"),
    (r"V/1000rpm", "V/krpm"),
    (r"(?<=/)rads?-1|rads-1|rad/sec", "rad/s"),
    (r"rads-2|rad/s/s|rad/sec2", "rad/s2"),
    (r"rad/sV|rad/s/V|rad/Vs", "rad/s/V"),
    (r"V/rad/s|Vs(ec)?/rad|Vs$", "Vs/rad"),
    (r"(oz|lb)s?f?-?in", r"\1in"),
    (r"(oz|lb)in-?s", r"\1ins"),
    (r"(?<=V)(olts?|DC|dc)\b", ""),
    (r"A-1$", "/A"),
    (r"N-cm", "Ncm"),
    (r"kg-m", "kgm"),
    (r"g-cm", "gcm"),
    (r"N-m", "Nm"),
    (r"inch(es)?|\"", "in"),
    (r"lbs", "lb"),
    (r"/(u|U|Umdr|umdr|round)$", "/rev"),
)
_NUMBER = re.compile(r"\s*([-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$", re.DOTALL)


# What stands around a value: powers of ten and groups of digits are written out, tolerances and conditions left out.
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_TEN = re.compile(r"\s*[x×·*]\s*10\s*\^?\s*([-⁻\u2212+]?[\d⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
_GROUPS = re.compile(r"(?<![\d.,])(\d{1,3})((?:[ '\u00a0\u2009\u202f\u2019]\d{3})+)(?!\d)")
_AROUND = re.compile(
    r"\(?\s*(?:±|\+\s*/\s*-)\s*[\d.,]+\s*%?\s*\)?|\s*(?:@|\bat\b)\s*[-+]?\d+\s*°\s*[CFK]|^\s*[~≈≃]"
    r"|\b(?:approx(?:imately)?|about|circa|ca|typ(?:ical)?|nom(?:inal)?)\b\.?",
    re.IGNORECASE,
)
_LIMIT = re.compile(r"^\s*[<>≤≥]|^\s*min(?:imum)?\b\.?(?=\s*[\d.])|\bmax(?:imum)?\b\.?", re.IGNORECASE)


def _alone(text: str) -> str:
    """A value and its unit without what a data sheet prints around them; of a limit, the limit."""
    text = _TEN.sub(lambda ten: f"e{ten[1].translate(_RAISED)}".replace("\u2212", "-"), text)
    text = _GROUPS.sub(lambda groups: groups[1] + re.sub(r"\D", "", groups[2]), text)
    return _LIMIT.sub("", _AROUND.sub("", text)).strip()


def value_of(text: str, kind: str, option: str) -> tuple[float, str]:
    """The value of an option in SI units, as in "2.3 ohm" or "14:1", and what must be told of it, or "".

    Raises UsageError: what is wrong, and what is right.
    """
    known = KINDS[kind]
    like = f"write it as in {option} {known.example!r}"
    found = _NUMBER.match(_as_ratio(text) if kind == "gear" else _alone(text))
    if not found:
        raise UsageError(f"{option}: {text[:40]!r} does not begin with a number; {like}")
    number, unit = found[1], _unit(found[2])
    if re.search(r",\d{3}$", number):
        raise UsageError(
            f"{option}: {number!r} is a thousand or a fraction; write it without a comma, as in {known.example!r}"
        )
    value = float(number.replace(",", ".")) * _factor(unit, known, option, text, like)
    if not known.least <= value <= known.most:
        raise UsageError(
            f"{option}: {text[:40]!r} is no {kind.replace('_', ' ')} of an actuator ({_range(known)}); {like}"
        )
    if _LIMIT.search(text):
        return value, f"{option} {text.strip()[:40]} is a limit, and is taken for the value"
    bare = known.said and not unit
    return value, f"{option} {number} has no unit and is taken as {number} {known.said}" if bare else ""


def _as_ratio(text: str) -> str:
    """A gear as in "14:1" of one that is printed as a reducer's 1:14, or as i = 14."""
    text = re.sub(r"^\s*(?:i|n|ratio)\s*[=:]?\s*", "", text, flags=re.IGNORECASE)
    reducer = re.fullmatch(r"\s*1\s*:\s*(\d+(?:\.\d+)?)\s*", text)
    return f"{reducer[1]}:1" if reducer else text


def _factor(unit: str, known: Kind, option: str, text: str, like: str) -> float:
    if unit in known.units:
        return known.units[unit]
    if not unit and known.own is not None:
        return known.own
    if not unit:
        raise UsageError(f"{option}: {text[:40]!r} has no unit; {like}")
    raise UsageError(f"{option}: there is no unit {unit[:20]!r} (known: {', '.join(known.units)}); {like}")


def _range(known: Kind) -> str:
    unit = next((u for u, f in known.units.items() if f == 1.0), "")
    return f"from {known.least:g} to {known.most:g} {unit}".strip()


def _unit(text: str) -> str:
    unit = text.translate(_SYMBOLS)
    for pattern, name in _NAMES:
        unit = re.sub(pattern, name, unit)
    return unit
