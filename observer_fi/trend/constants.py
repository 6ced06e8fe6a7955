"""Quantities of a log of a rig whose constants are known: what `identify` makes of this log alone, play at reversals, and what
the constants leave unexplained.
"""

import math
from dataclasses import replace

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
FOLLOWS = (
    3.0  # noises of the position by which a simulated mass has gone when the measured one counts as behind
)
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
    found += _play(fit, rig) + _misfit(fit)
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


def _play(fit: Fit, rig: Rig) -> list[Set]:
    """How far the motor turns at a reversal before the mass follows, and how late the position is seen [m, s].

    A simulated move starts from where the mass stood. After a reversal it falls short of that by the play.
    """
    rows, y, reversed_once = [], [], False
    for one in fit.figures.get("fits", []):
        before = 0.0
        for k, peak in enumerate(one["peak"]):
            here = np.flatnonzero(one["move"] == k)
            way, x = float(np.sign(peak)), one["simulated"][here, 2]
            left = one["measured"][here, 2] - x
            known = np.isfinite(left)
            if np.count_nonzero(known) > FEWEST:
                v = np.gradient(x, one["time"][here])
                follows = np.abs(x - x[0]) > FOLLOWS * rig.noise["position"]
                short = -way * follows * (before == -way)
                rows.append(np.column_stack([short, -v, x - x[0], np.ones(x.size)])[known])
                y.append(left[known])
                reversed_once |= before == -way
            before = way
    if not reversed_once:
        return []
    blocks = np.zeros((sum(g.shape[0] for g in rows), 3 + len(rows)))
    at = 0
    for k, g in enumerate(rows):
        blocks[at : at + g.shape[0], :3], blocks[at : at + g.shape[0], 3 + k] = g[:, :3], g[:, 3]
        at += g.shape[0]
    theta, covariance, _ = regression(blocks, np.concatenate(y))
    return [(("backlash", "position_lag"), ("m", "s"), theta[:2], covariance[:2, :2])]


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
