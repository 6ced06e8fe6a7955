"""Quantities of a log of a rig whose constants are known: what `identify` makes of this log alone, play at reversals, and what
the constants leave unexplained.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer_fi.errors import InvalidLogError
from observer_fi.learn import identify
from observer_fi.logs import with_command
from observer_fi.physics import PARAMETERS, Quantity, Rig
from observer_fi.records import Array, Fit, Log
from observer_fi.trend.travel import Set, regression

# How wide the maker's data are taken: a winding warms by 30 K, a gain of the position sensor looks like another D. Torque and
# current are known by Km alone, and B by the baseline, whose logs differ in pitch.
ROOM = {"Rm": 0.1, "D": 0.02, "B": 1e-4}
FASTEST_NEEDED_HZ = 100.0  # of a log whose constants are told from integrals over quarters of a second
PLAYS = (0.0, 3e-5, 1e-4)  # m, from which the play is sought
STEPS = 8  # towards it
FEWEST = 50  # samples of a move that begin to tell play
CHANNELS = {"current_a": "misfit_current", "position_m": "misfit_position", "speed_rad_s": "misfit_speed"}


def has_constants(log: Log, rig: Rig) -> bool:
    """Whether a log's constants can be told: a motor with its voltage, sampled fast enough."""
    known = rig.driven.motor and rig.model["Rm"] > 0.0 and bool(np.isfinite(log.z[:, 0]).any())
    return known and log.rate_hz >= FASTEST_NEEDED_HZ


def quantities(log: Log, rig: Rig) -> tuple[list[Set], dict[str, str], dict[str, float]]:
    """Constants of this log, what it cannot tell and why, and its conditions. Raises InvalidLogError where it has no move."""
    log = with_command(log, rig)
    fit = identify([log], _roomy(rig))
    found = [_constants(fit)]
    found += _play(fit) + _misfit(fit)
    return found, dict(fit.not_identifiable), _conditions(log, fit)


def _roomy(rig: Rig) -> Rig:
    given = {n: q for n, q in rig.quantities.items() if n in ROOM}
    wide: dict[str, Quantity] = {n: replace(q, spread=ROOM[n]) for n, q in given.items()}
    return replace(rig, quantities={**rig.quantities, **wide})


def _constants(fit: Fit) -> Set:
    kept = [k for k, p in enumerate(fit.parameters) if p.name in PARAMETERS and math.isfinite(p.std)]
    if not kept:
        raise InvalidLogError(
            "no constant can be told from this log; record moves from rest in both directions"
        )
    std = np.array([fit.parameters[k].std for k in kept])
    covariance = fit.correlation[np.ix_(kept, kept)] * np.outer(std, std)
    names = tuple(fit.parameters[k].name for k in kept)
    return (
        names,
        tuple(fit.parameters[k].unit for k in kept),
        np.array([fit.parameters[k].value for k in kept]),
        covariance,
    )


class _Reversals(NamedTuple):
    """The moves of a log, one after the other. left (n,) m: measured less simulated position; gone (n,) m: how far the simulated
    mass has gone; way (n,): +1 or -1 after a reversal, 0 before the first; others (n, 2 + M): what else the position may be
    off by, as columns: lag, travel per turn, and where each of the M moves began.
    """

    left: Array
    gone: Array
    way: Array
    others: Array


def _play(fit: Fit) -> list[Set]:
    """How far the motor turns at a reversal before the mass follows, and how late the position is seen [m, s].

    A simulated move starts from where the mass stood. After a reversal the mass lags behind it as far as it has gone, and
    by the play from there on: min(gone, play), fitted by Gauss and Newton's steps from several widths.
    """
    log = _reversals(fit)
    if log is None:
        return []
    Q = np.linalg.qr(log.others)[0]
    width = min((_width(log, Q, start) for start in PLAYS), key=lambda w: _unexplained(log, Q, w))
    column = -log.way * (log.gone > width)
    y = log.left + log.way * np.minimum(log.gone, width) + column * width
    theta, covariance, _ = regression(np.column_stack([column, log.others]), y)
    return [(("backlash", "position_lag"), ("m", "s"), theta[:2], covariance[:2, :2])]


def _width(log: _Reversals, Q: Array, width: float) -> float:
    """The play of least squares near to this one; Q (n, 2 + M): an orthonormal basis of the other columns."""
    for _ in range(STEPS):
        column = -log.way * (log.gone > width)
        column = column - Q @ (Q.T @ column)
        square = float(column @ column)
        if square <= 0.0:
            break
        width = max(width + float(column @ (log.left + log.way * np.minimum(log.gone, width))) / square, 0.0)
    return width


def _unexplained(log: _Reversals, Q: Array, width: float) -> float:
    r = log.left + log.way * np.minimum(log.gone, width)
    return float(r @ r - np.sum((Q.T @ r) ** 2))


def _reversals(fit: Fit) -> _Reversals | None:
    """The moves of a fit with what precedes them; None where no move turns back."""
    found = []
    for one in fit.figures.get("fits", []):
        before = 0.0
        for k, peak in enumerate(one["peak"]):
            here = np.flatnonzero(one["move"] == k)
            way, x = float(np.sign(peak)), one["simulated"][here, 2]
            left = one["measured"][here, 2] - x
            known = np.isfinite(left)
            if np.count_nonzero(known) > FEWEST:
                v = np.gradient(x, one["time"][here])
                gone = np.maximum(way * (x - x[0]), 0.0)
                back = np.full(x.size, way * (before == -way))
                found.append(np.column_stack([left, gone, back, -v, x - x[0]])[known])
            before = way
    if not any(np.any(g[:, 2]) for g in found):
        return None
    every = np.concatenate(found)
    began = np.repeat(np.eye(len(found)), [g.shape[0] for g in found], axis=0)
    return _Reversals(every[:, 0], every[:, 1], every[:, 2], np.column_stack([every[:, 3:], began]))


def _misfit(fit: Fit) -> list[Set]:
    """Logarithm of what the constants leave of each channel."""
    left = {CHANNELS[n]: v for n, v in fit.rmse.items() if n in CHANNELS and v > 0.0}
    if not left:
        return []
    samples = sum(one["time"].size for one in fit.figures.get("fits", [])) or fit.figures.get("samples", 100)
    variance = np.full(len(left), 0.5 / max(samples, 2))
    return [(tuple(left), ("1",) * len(left), np.log(np.array(list(left.values()))), np.diag(variance))]


def _conditions(log: Log, fit: Fit) -> dict[str, float]:
    peaks: Array = np.concatenate(
        [np.abs(one["peak"]) for one in fit.figures.get("fits", [])] or [np.zeros(0)]
    )
    speed = float(peaks.mean()) if peaks.size else float(np.nanmax(np.abs(log.w_cmd), initial=0.0))
    load = 0.0 if log.load is None else float(np.nanmean(log.load))
    return {"load_n": load, "pitch_deg": float(np.nanmean(log.pitch)), "speed_rad_s": speed}
