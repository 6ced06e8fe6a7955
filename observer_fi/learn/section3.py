"""Section 3 of the paper: one function per step, each a linear regression with its equation and standard error.

The phases follow one another, so the steps do too: source (V against i while saturated), friction (steady state),
inertia (equation 17), gains (equation 18), contact (figure 4), compression (x against motor angle). No step needs an
optimiser: exponentials and damped sinusoids are fitted through the integrals of the equations that they solve.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.learn.contacts_and_losses import motor_angle, speed_of
from observer_fi.logs import settling_time
from observer_fi.numerics import runs
from observer_fi.physics import Model
from observer_fi.records import Array, Log, Segment

PLATEAU_S = 0.006  # a source that follows its command holds 0.5 % of its peak for 2 ms at most
PLATEAU = 0.005
_FEWEST = 6  # samples of a phase
_SCAN = 201  # contact points tried


class Step(NamedTuple):
    """One step of section 3: the equation, values and standard errors by parameter (SI), and arrays of its figure."""

    equation: str
    values: dict[str, float]
    std: dict[str, float]
    arrays: dict[str, Array]


class Start(NamedTuple):
    """Rows of a log in which one start is saturated, and the move it belongs to."""

    first: int
    last: int
    move: Segment


def regression(G: Array, y: Array) -> tuple[Array, Array]:
    """Least squares: coefficients (k,) and their covariance (k, k) from the residual. G (n, k), y (n,)."""
    scale = np.maximum(np.linalg.norm(G, axis=0), 1e-300)
    x, _, _, _ = np.linalg.lstsq(G / scale, y, rcond=1e-12)
    left = y - G / scale @ x
    variance = float(left @ left) / max(y.size - x.size, 1)
    covariance = variance * np.linalg.pinv((G / scale).T @ (G / scale))
    return x / scale, covariance / np.outer(scale, scale)


def saturated_starts(log: Log, moves: Sequence[Segment], model: Model) -> list[Start]:
    """Starts that hold their largest V + Rs i for longer than a following source could (equation 5)."""
    found = []
    span = max(_FEWEST, round(PLATEAU_S * log.rate_hz))
    for move in moves:
        stop = min(move.start + round(settling_time(model) * log.rate_hz), move.stop)
        y = np.sign(move.peak) * (log.z[move.start : stop, 0] + model["Rs"] * log.z[move.start : stop, 1])
        if y.size < span or not np.isfinite(y).any():
            continue
        top = np.sort(y[np.isfinite(y)])[-min(span, y.size) :].mean()
        first, last = _longest(np.nan_to_num(y, nan=-np.inf) > (1.0 - PLATEAU) * top)
        if last - first >= span:
            found.append(Start(move.start + first + 1, move.start + last - 1, move))
    if not found:
        return []
    heights = np.array(
        [
            np.nanmean(np.abs(log.z[s.first : s.last, 0] + model["Rs"] * log.z[s.first : s.last, 1]))
            for s in found
        ]
    )
    return [s for s, h in zip(found, heights, strict=True) if h > 0.98 * heights.max()]


def _longest(mask: NDArray[np.bool_]) -> tuple[int, int]:
    """The longest run of True: its first row and the row after its last; (0, 0) where there is none."""
    starts, stops = runs(mask)
    if not starts.size:
        return 0, 0
    k = int(np.argmax(stops - starts))
    return int(starts[k]), int(stops[k])


def source(log: Log, starts: Sequence[Start]) -> Step | None:
    """Equation 15 while saturated: V = Vmax - Rs i, slope and intercept. None without a saturated start."""
    if not starts:
        return None
    rows = np.concatenate([np.arange(s.first, s.last) for s in starts])
    sign = np.concatenate([np.full(s.last - s.first, np.sign(s.move.peak)) for s in starts])
    V, i = sign * log.z[rows, 0], sign * log.z[rows, 1]
    good = np.isfinite(V) & np.isfinite(i)
    V, i = V[good], i[good]
    if V.size < _FEWEST or np.ptp(i) < 0.05:
        return None
    x, covariance = regression(np.column_stack([np.ones(V.size), -i]), V)
    return Step(
        "15",
        {"Vmax": float(x[0]), "Rs": float(x[1])},
        _errors(("Vmax", "Rs"), covariance),
        {"current": i, "voltage": V, "fitted": x[0] - x[1] * i},
    )


def friction(
    log: Log, moves: Sequence[Segment], model: Model, names: tuple[str, str] = ("A", "B")
) -> Step | None:
    """Equation 7 in steady state: Km i = sgn(w) A + B theta, one mean torque per move. Both, or A where pitch is one.

    names: what to call the two; ("A_decoupled", "") for decoupled moves, whose pitch is not felt (equation 13).
    """
    spans = [(m, slice(_steady_from(log, m, model), m.stop - round(0.02 * log.rate_hz))) for m in moves]
    rows = [(m, r) for m, r in spans if r.stop - r.start > 20]
    if not rows:
        return None
    current = np.array([np.nanmean(log.z[r, 1]) for _, r in rows])
    noise = np.array([np.nanstd(log.z[r, 1]) / np.sqrt(r.stop - r.start) for _, r in rows])
    pitch = np.array([np.nanmean(log.pitch[r]) for _, r in rows])
    sign = np.array([np.sign(m.peak) for m, _ in rows])
    torque = model["Km"] * current
    both = bool(names[1]) and np.ptp(pitch) > 1.0
    known = 0.0 if both or not names[1] else model["B"] * pitch
    weight = 1.0 / np.maximum(model["Km"] * noise, 1e-12)
    G = np.column_stack([sign, pitch]) if both else sign[:, None]
    x, covariance = regression(weight[:, None] * G, weight * (torque - known))
    used = names if both else names[:1]
    values = {n: float(v) for n, v in zip(used, x, strict=True)}
    arrays = {"pitch": pitch, "torque": torque, "fitted": known + G @ x, "direction": sign}
    return Step("7" if names[1] else "13", values, _errors(used, covariance), arrays)


def _steady_from(log: Log, move: Segment, model: Model) -> int:
    return move.start + round((0.06 + settling_time(model)) * log.rate_hz)


def inertia(log: Log, starts: Sequence[Start], model: Model, name: str = "J") -> Step | None:
    """Equation 17: J = tau Km^2 / R from w(t) = w(ts) + (1/tau) int (w0 - w) dt over the saturated phase.

    The asymptote w0 = (Vmax - R torque/Km)/Km is that of the saturated phase; ts is where saturation begins.
    """
    R = model["Rm"] + model["Rs"]
    w = speed_of(log, model)
    drag = model["A"] if name == "J" else model["A_decoupled"]
    taus, errors, arrays = [], [], {}
    for s in starts:
        t, y, sign = log.t[s.first : s.last], w[s.first : s.last], np.sign(s.move.peak)
        if not np.isfinite(y).all() or y.size < _FEWEST:
            continue
        load = drag + (sign * model["B"] * s.move.pitch if name == "J" else 0.0)
        asymptote = (model["Vmax"] - R * load / model["Km"]) / model["Km"]
        G = np.column_stack([np.ones(t.size), motor_angle(t, asymptote - sign * y)])
        x, covariance = regression(G, sign * y)
        taus.append(1.0 / x[1])
        errors.append(np.sqrt(covariance[1, 1]) / x[1] ** 2)
        arrays = {"time": t - t[0], "speed": sign * y, "fitted": G @ x}
    if not taus:
        return None
    tau, error = _pooled(np.array(taus), np.array(errors))
    scale = model["Km"] ** 2 / R
    return Step("17", {name: tau * scale}, {name: error * scale}, arrays)


def gains(log: Log, moves: Sequence[Segment], starts: Sequence[Start], model: Model) -> Step | None:
    """Equation 18: Kp = 2 J / (Km tau_decay), Ki = J (w_osc^2 + 1/tau_decay^2) / Km, from the stabilisation phase.

    y = w - w_cmd solves y'' + (2/tau) y' + (w_osc^2 + 1/tau^2) y = 0, fitted through its double integral.
    """
    w = speed_of(log, model)
    rates, errors, arrays = [], [], {}
    for move in moves:
        after = [s.last + 2 for s in starts if s.move is move]
        first = (
            after[0]
            if after
            else move.start + round(abs(move.peak) / (model["accel_cmd"] or np.inf) * log.rate_hz) + 2
        )
        last = min(first + round(settling_time(model) * log.rate_hz), move.stop - round(0.02 * log.rate_hz))
        t, y = log.t[first:last], (w - log.w_cmd)[first:last]
        if last - first < 40 or not np.isfinite(y).all():
            continue
        once = motor_angle(t, y)
        G = np.column_stack([np.ones(t.size), t - t[0], -once, -motor_angle(t, once)])
        x, covariance = regression(G, y)
        if x[2] <= 0.0 or x[3] <= 0.0:
            continue
        rates.append(x[2:])
        errors.append(np.sqrt(np.diag(covariance))[2:])
        arrays = {"time": t - t[0], "error": y, "fitted": G @ x}
    if not rates:
        return None
    pooled = [_pooled(np.array(rates)[:, k], np.array(errors)[:, k]) for k in range(2)]
    scale = model["J"] / model["Km"]
    return Step(
        "18",
        {"Kp": scale * pooled[0][0], "Ki": scale * pooled[1][0]},
        {"Kp": scale * pooled[0][1], "Ki": scale * pooled[1][1]},
        arrays,
    )


def contact(log: Log, move: Segment, model: Model, stop: float, side: float) -> Step | None:
    """Figure 4: Km i - friction - load = C (x - x_c)^2 on averages of 20 ms, best of many x_c near the rough one.

    side: 1 for the high stop, -1 for the low one. stop [m]: where a bend of x against the angle puts it.
    """
    block = max(1, round(0.02 * log.rate_hz))
    first = _steady_from(log, move, model)
    count = (move.stop - first) // block
    if count < 10:
        return None
    rows = slice(first, first + count * block)
    parts = [v[rows].reshape(count, block) for v in (log.z[:, 2], log.z[:, 1], log.pitch)]
    read = np.all([np.isfinite(part).any(axis=1) for part in parts], axis=0)
    x, i, theta = (np.nanmean(part[read], axis=1) for part in parts)
    torque = side * (model["Km"] * i - np.sign(move.peak) * model["A"] - model["B"] * theta)
    best = None
    for place in stop + np.linspace(-4e-4, 4e-4, _SCAN):
        depth = np.maximum(side * (x - place), 0.0) ** 2
        if (depth > 0.0).sum() < 4:
            continue
        C = float(depth @ torque / (depth @ depth))
        cost = float(np.sum((torque - C * depth) ** 2))
        if best is None or cost < best[0]:
            best = (cost, place, C)
    if best is None:
        return None
    cost, place, C = best
    depth = np.maximum(side * (x - place), 0.0)
    name = "x_stop_high" if side > 0.0 else "x_stop_low"
    _, covariance = regression(np.column_stack([depth**2, -2.0 * side * C * depth]), torque)
    scatter = cost / max(torque.size - 2, 1) / max(float(np.var(torque - C * depth**2)), 1e-30)
    return Step(
        "11",
        {"C": C, name: place},
        _errors(("C", name), covariance * max(scatter, 1.0)),
        {"x": x, "torque": torque, "fitted": C * depth**2},
    )


def compression(log: Log, move: Segment, model: Model, stop: float, side: float) -> Step | None:
    """Equation 10: E from the slope D (1 - E) of x against the motor angle in contact."""
    rows = slice(move.start, move.stop)
    x, angle = log.z[rows, 2], motor_angle(log.t[rows], speed_of(log, model)[rows])
    inside = np.isfinite(x) & (side * (x - stop) > 5e-5)
    if inside.sum() < 50 or np.ptp(angle[inside]) * model["D"] < 1e-4:
        return None
    G = np.column_stack([np.ones(int(inside.sum())), angle[inside]])
    fit, covariance = regression(G, x[inside])
    values = {"E": 1.0 - float(fit[1]) / model["D"]}
    return Step(
        "10",
        values,
        {"E": float(np.sqrt(covariance[1, 1])) / model["D"]},
        {"angle": angle[inside], "x": x[inside], "fitted": G @ fit},
    )


def _errors(names: Sequence[str], covariance: Array) -> dict[str, float]:
    return {n: float(np.sqrt(max(v, 0.0))) for n, v in zip(names, np.diag(covariance), strict=True)}


def _pooled(values: Array, errors: Array) -> tuple[float, float]:
    """Weighted mean and its error, or the error of the scatter where that is larger."""
    weight = 1.0 / np.maximum(errors, 1e-300) ** 2
    mean = float((weight * values).sum() / weight.sum())
    scatter = float(np.std(values) / np.sqrt(values.size)) if values.size > 1 else 0.0
    return mean, max(float(1.0 / np.sqrt(weight.sum())), scatter)
