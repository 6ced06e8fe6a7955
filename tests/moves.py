"""Logs of the hidden truth as records, whole or cut to what a test needs."""

from dataclasses import replace
from functools import cache

import numpy as np
from hidden import Fault, TruthSpec, draw_move_case, make_log

from observer_fi.records import Event, Log


@cache
def case(seed: int, label: str) -> TruthSpec:
    """One move with a fault of this class."""
    return draw_move_case(seed, label)


@cache
def move(seed: int, label: str, rate_hz: float = 1600.0) -> Log:
    """The log of a case at a rate."""
    spec = case(seed, label)
    frame, _ = make_log(replace(spec, logger=replace(spec.logger, rate_hz=rate_hz)), seed)
    t, v, i, x, pitch, command = frame.to_numpy(float).T
    return Log(f"{label}-{seed}", t.copy(), np.column_stack((v, i, x)), command.copy(), pitch.copy())


def onset(seed: int, label: str) -> float:
    """When the fault of a case begins [s]; where there is none, a moment in the move."""
    at = case(seed, label).fault.onset_s
    return 0.5 if at is None else float(at)


def cut(log: Log, first: float, last: float) -> Log:
    """The samples between two times [s], copied."""
    return rows(log, (log.t >= first) & (log.t < last))


def rows(log: Log, chosen: np.ndarray | slice) -> Log:
    """The samples that an index picks, copied."""
    names = ("t", "z", "w_cmd", "pitch")
    return replace(log, **{name: getattr(log, name)[chosen].copy() for name in names})


def holed(log: Log, seed: int, share: float = 0.1) -> Log:
    """With this share of single readings missing, then a stretch of all three, then a gap in the clock."""
    rng = np.random.default_rng(seed)
    n = log.t.size
    out = rows(log, slice(None))
    out.z[rng.random(out.z.shape) < share] = np.nan
    out.z[n // 5 : n // 5 + n // 20] = np.nan
    keep = np.ones(n, dtype=bool)
    keep[n // 3 : n // 3 + n // 10] = False
    return rows(out, keep)


def failing(seed: int, kind: str, channel: str, size: float, onset_s: float) -> TruthSpec:
    """A healthy move in which one sensor fails so at that time."""
    fault = Fault("sensor_fault", onset_s, kind, channel, size)
    return replace(draw_move_case(seed, "nominal"), fault=fault)


def sure_of(label: str, onset_s: float, end_s: float) -> Event:
    """The verdict of which a bank was sure, on a move from 0.3 s on."""
    return Event(label, None, 1.0, onset_s, (onset_s, onset_s), onset_s, onset_s, 0.3, end_s, {label: 1.0})
