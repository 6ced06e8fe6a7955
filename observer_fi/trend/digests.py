"""What one log says of its actuator: physical quantities with their covariance, and the conditions they were seen under.

A digest is made from one log alone, so that it can be kept: a log that is added costs itself and no other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from observer_fi.records import Array

SCHEMA = "observer-fi/digest/2"


@dataclass(frozen=True)
class Curve:
    """What friction's smooth part leaves of the torque along the travel: x (m,) m, torque (m,) N m, way (m,) +1 or -1.

    step_s: between two samples, of those that follow one another.
    """

    x: Array
    torque: Array
    way: Array
    step_s: float


@dataclass(frozen=True)
class Digest:
    """Quantities of one log, its conditions, and what could not be told.

    names, units: of the k quantities; value (k,); covariance (k, k) of the estimate, from this log's own noise.
    conditions: mean pitch [deg], load [N], speed [rad/s] and the like. missing: quantity and why the log cannot tell it.
    time: recorded at, as text, "" where the log does not say. curve: None where there is nothing to look for ripple in.
    """

    path: str
    sha256: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    covariance: Array
    conditions: Mapping[str, float]
    missing: Mapping[str, str] = field(default_factory=dict)
    time: str = ""
    curve: Curve | None = None
    notes: tuple[str, ...] = ()


def joined(
    parts: Sequence[tuple[Sequence[str], Sequence[str], Array, Array]],
) -> tuple[Any, Any, Array, Array]:
    """Names, units, values and block-diagonal covariance of several sets of quantities (each in that order)."""
    names = tuple(n for part in parts for n in part[0])
    units = tuple(u for part in parts for u in part[1])
    value = np.concatenate([part[2] for part in parts]) if parts else np.empty(0)
    covariance = np.zeros((value.size, value.size))
    at = 0
    for part in parts:
        k = len(part[0])
        covariance[at : at + k, at : at + k] = part[3]
        at += k
    return names, units, value, covariance


def to_plain(digest: Digest) -> dict[str, Any]:
    """The digest as data for JSON; a covariance as standard errors and correlations."""
    std = np.sqrt(np.diag(digest.covariance))
    curve = digest.curve
    return {
        "schema": SCHEMA, "path": digest.path, "sha256": digest.sha256, "names": list(digest.names),
        "units": list(digest.units), "value": digest.value.tolist(), "std": std.tolist(),
        "covariance": digest.covariance.tolist(), "conditions": dict(digest.conditions),
        "missing": dict(digest.missing), "time": digest.time, "notes": list(digest.notes),
        "curve": None if curve is None else {
            "x": curve.x.tolist(), "torque": curve.torque.tolist(), "way": curve.way.tolist(), "step_s": curve.step_s,
        },
    }  # fmt: skip


def from_plain(found: Mapping[str, Any]) -> Digest:
    """A digest from what `to_plain` wrote. Raises KeyError, TypeError or ValueError where it is not that."""
    if found["schema"] != SCHEMA:
        raise ValueError(f"schema {found['schema']!r}, expected {SCHEMA!r}")
    k = len(found["names"])
    return Digest(
        found["path"], found["sha256"], tuple(found["names"]), tuple(found["units"]),
        np.array(found["value"], dtype=float), np.array(found["covariance"], dtype=float).reshape(k, k),
        dict(found["conditions"]), dict(found["missing"]), found["time"], _curve(found["curve"]), tuple(found["notes"]),
    )  # fmt: skip


def _curve(found: Mapping[str, Any] | None) -> Curve | None:
    if found is None:
        return None
    x, torque, way = (np.array(found[name], dtype=float) for name in ("x", "torque", "way"))
    return Curve(x, torque, way, float(found["step_s"]))


def recorded_at(metadata: Sequence[str]) -> str:
    """The time of recording that the lines before the header give, as ISO text; "" where they give none."""
    from datetime import datetime

    for line in metadata:
        for word in _after_colons(line.lstrip("# ").strip()):
            try:
                return datetime.fromisoformat(word).isoformat()
            except ValueError:
                continue
    return ""


def _after_colons(line: str) -> list[str]:
    """The line itself, and what follows its first colon or equals sign."""
    ends = [k for k in (line.find(":"), line.find("=")) if k >= 0]
    return [line, *(line[k + 1 :].strip() for k in sorted(ends))]
