"""Arrays as pages hold them, unpacked: what `charts.js` does, in a few lines."""

import base64
from typing import Any

import numpy as np


def unpacked(packed: Any) -> np.ndarray:
    """The numbers of an array that report/interactive.py packed; NaN where nothing is known."""
    if isinstance(packed, list):
        return np.array([np.nan if v is None else v for v in packed], dtype=float)
    raw = np.frombuffer(base64.b64decode(packed["data"]), dtype="<" + packed["kind"])
    if packed["kind"] != "u2":
        return raw.astype(float)
    scaled = packed["low"] + (packed["high"] - packed["low"]) * raw / 65534.0
    return np.where(raw > 65534, np.nan, scaled)
