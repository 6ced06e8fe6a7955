"""Quantities of a log of a rig whose constants are known: what `identify` makes of this log alone, play at reversals, and what
the constants leave unexplained.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs import with_command, without_winding
from observer_fi.physics import PARAMETERS, Quantity, Rig
from observer_fi.records import Array, Fit, Log
from observer_fi.trend.travel import Set, regression

# How wide the maker's data are taken: a winding warms by 30 K, a gain of the position sensor looks like another D. Torque and
# current are known by Km alone, and B by the baseline, whose logs differ in pitch.
ROOM = {"Rm": 0.1, "D": 0.02, "B": 1e-4}
FASTEST_NEEDED_HZ = 100.0  # of a log whose constants are told from integrals over quarters of a second
PLAYS = (0.0, 3e-5, 1e-4)  # m, from which the play is sought
STEPS = 8  # towards it
SETTLES, REST = (
    0.1,
    0.5,
)  # s after a move until its mass stands, and of the rest before one that tell where it stood
# A position sensor is read within some 2 ms. One that is later by more standard errors than this shows it by itself.
LAG_ROOM, LAG_SHOWS = 2e-3, 3.0
FEWEST = 50  # samples of a move that begin to tell play
CHANNELS = {"current_a": "misfit_current", "position_m": "misfit_position", "speed_rad_s": "misfit_speed"}


def has_constants(log: Log, rig: Rig) -> bool:
    """Whether a log's constants can be told: a motor with its voltage, sampled fast enough."""
    known = rig.driven.motor and rig.model["Rm"] > 0.0 and bool(np.isfinite(log.z[:, 0]).any())
    return known and log.rate_hz >= FASTEST_NEEDED_HZ


def quantities(log: Log, rig: Rig) -> tuple[list[Set], dict[str, str], dict[str, float]]:
    """Constants of this log, what it cannot tell and why, and its conditions. Raises InvalidLogError where it has no move."""
    from observer_fi.learn import identify  # a second to import, for logs that are new

    log = without_winding(with_command(log, rig), rig)
    # A filter is the logger's: looked for in each log for itself, it would come and go with its other constants.
    fit = identify([log], _roomy(rig), filters=False)
    play = _play(log, fit)
    found = [_constants(fit, {name for names, *_ in play for name in names}), *play, *_misfit(fit)]
    return found, dict(fit.not_identifiable), _conditions(log, fit)


def _roomy(rig: Rig) -> Rig:
    given = {n: q for n, q in rig.quantities.items() if n in ROOM}
    wide: dict[str, Quantity] = {n: replace(q, spread=ROOM[n]) for n, q in given.items()}
    return replace(rig, quantities={**rig.quantities, **wide})


def _constants(fit: Fit, beside: set[str]) -> Set:
    """The constants of a fit but for those that are told `beside` it."""
    told = [k for k, p in enumerate(fit.parameters) if p.name in PARAMETERS and math.isfinite(p.std)]
    kept = [k for k in told if fit.parameters[k].name not in beside]
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


class Reversals(NamedTuple):
    """The moves of a log, one after the other. left (n,) m: measured less simulated position; gone (n,) m: how far the simulated
    mass has gone; way (n,): +1 or -1 after a reversal, 0 before the first; others (n, 2 + M): what else the position may be
    off by, as columns: lag, travel per turn, and where each of the M moves began. known (r, 2 + M) of these columns are
    `amount` (r,) m, each row multiplied by how many readings say so: where the mass stood before it turned back.
    """

    left: Array
    gone: Array
    way: Array
    others: Array
    known: Array
    amount: Array


def _play(log: Log, fit: Fit) -> list[Set]:
    """How far the motor turns at a reversal before the mass follows, how late the position is seen [m, s], and D.

    A simulated move starts from where the mass stood. After a reversal the mass lags behind it as far as it has gone, and
    by the play from there on: min(gone, play), fitted by Gauss and Newton's steps from several widths. A width below zero
    is the scatter of a mean of zero: cut off, healthy logs would have play, and what grows would begin late.
    The fit knows no play and takes it for a smaller D, which is told anew here.
    """
    seen = _reversals(log, fit)
    if seen is None:
        return []
    theta, covariance = play_and_lag(seen)
    names: tuple[str, ...] = ("backlash", "position_lag")
    units: tuple[str, ...] = ("m", "s")
    before = np.zeros(2)
    scale = np.ones(2)
    for p in fit.parameters:
        if p.name == "D":
            names, units = (*names, "D"), (*units, p.unit)
            before, scale = np.append(before, p.value), np.append(scale, p.value)
    n = len(names)
    return [(names, units, before + scale * theta[:n], covariance[:n, :n] * np.outer(scale, scale))]


def play_and_lag(seen: Reversals) -> tuple[Array, Array]:
    """Play [m], lag [s] and what else is off, (3 + M,), and their covariance: the lag small, unless the log shows it."""
    theta, covariance = _fitted(seen)
    shown = max(abs(float(theta[1])) - LAG_SHOWS * math.sqrt(covariance[1, 1]), 0.0)
    return _fitted(_lag_within(seen, math.hypot(LAG_ROOM, shown)))


def _lag_within(seen: Reversals, room: float) -> Reversals:
    """With a lag of zero give or take `room` [s]. At one speed a lag is where the move began, and hides the play."""
    noise = float(np.median(np.abs(np.diff(seen.left)))) / (0.6745 * math.sqrt(2.0))
    row = np.eye(1, seen.others.shape[1]) * noise / room
    return seen._replace(known=np.vstack([seen.known, row]), amount=np.append(seen.amount, 0.0))


def _fitted(seen: Reversals) -> tuple[Array, Array]:
    """Play, lag and the other columns' coefficients, and their covariance, from the best of several starts."""
    Q = np.linalg.qr(np.concatenate([seen.others, seen.known]))[0]
    width = min((_width(seen, Q, start) for start in PLAYS), key=lambda w: _unexplained(seen, Q, w))
    column, y = _after(seen, width)
    G = np.column_stack([column, np.concatenate([seen.others, seen.known])])
    theta, covariance, _ = regression(G, y)
    return theta, covariance


def _after(seen: Reversals, width: float) -> tuple[Array, Array]:
    """(n + r,) What a wider play changes, and what the columns have to explain, the play of this width put back."""
    column = -seen.way * (seen.gone > max(width, 0.0))
    y = seen.left + seen.way * np.minimum(seen.gone, max(width, 0.0)) + column * max(width, 0.0)
    return np.append(column, np.zeros(seen.amount.size)), np.append(y, seen.amount)


def _width(seen: Reversals, Q: Array, width: float) -> float:
    """The play of least squares near to this one; Q (n + r, 2 + M): an orthonormal basis of the other columns."""
    for _ in range(STEPS):
        column, y = _after(seen, width)
        column = column - Q @ (Q.T @ column)
        square = float(column @ column)
        if square <= 0.0:
            break
        width = float(column @ y) / square
    return width


def _unexplained(seen: Reversals, Q: Array, width: float) -> float:
    column, y = _after(seen, width)
    r = y - column * width
    return float(r @ r - np.sum((Q.T @ r) ** 2))


def _reversals(log: Log, fit: Fit) -> Reversals | None:
    """The moves of a fit with what precedes them; None where no move turns back."""
    found, stood = [], []
    for one in fit.figures.get("fits", []):
        before, ended = 0.0, -math.inf
        for k, peak in enumerate(one["peak"]):
            here = np.flatnonzero(one["move"] == k)
            way, turned = float(np.sign(peak)), before == -float(np.sign(peak))
            if np.count_nonzero(np.isfinite(one["measured"][here, 2])) > FEWEST:
                found.append(_samples(one, here, way, turned))
                began, x = float(one["time"][here[0]]), float(one["simulated"][here[0], 2])
                stood.append(_stood(log, ended, began, x) if turned else (0.0, 0))
            before, ended = way, float(one["time"][here[-1]]) if here.size else ended
    if not any(np.any(g[:, 2]) for g in found):
        return None
    every, weight = np.concatenate(found), np.sqrt([n for _, n in stood])
    began_at = np.repeat(np.eye(len(found)), [g.shape[0] for g in found], axis=0)
    known = np.column_stack([np.zeros((len(found), 2)), np.diag(weight)])
    amount = weight * np.array([off for off, _ in stood])
    return Reversals(
        every[:, 0], every[:, 1], every[:, 2], np.column_stack([every[:, 3:], began_at]), known, amount
    )


def _samples(one: Mapping[str, Any], here: NDArray[np.intp], way: float, turned: bool) -> Array:
    """(n, 5) of a move's samples: left, gone, way and the columns of lag and travel per turn."""
    x = one["simulated"][here, 2]
    left = one["measured"][here, 2] - x
    gone = np.maximum(way * (x - x[0]), 0.0)
    v = np.gradient(x, one["time"][here])
    rows = np.column_stack([left, gone, np.full(x.size, way * turned), -v, x - x[0]])
    return np.asarray(rows[np.isfinite(left)], dtype=float)


def _stood(log: Log, ended: float, began: float, x: float) -> tuple[float, int]:
    """Where the mass stood before a move, less x [m], and how many readings say so: of the rest's end, once it has settled."""
    rest = (log.t > max(ended + SETTLES, began - REST)) & (log.t < began) & np.isfinite(log.z[:, 2])
    return (float(log.z[rest, 2].mean()) - x, int(rest.sum())) if rest.any() else (0.0, 0)


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
