"""How visible a hidden effect is, once a refit of the rig has hidden what it can of it: a linear study.

The unit is one standard deviation of white noise over the whole log: 5 is the limit of a perfect analyst. One
who must choose among thirty causes with correlated residuals needs some 20, and a sampled servo that is
modelled as a continuous one leaves about 200 itself, 65 of them after a fitted delay and lag.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from .effects import Effect, fields_of, sized_effect
from .sensors import COLUMNS, Logger
from .truth import TruthSpec, make_log, without_noise

VISIBLE_SIGMA = 50.0  # what the small sizes of the table are made for
NOISE = {
    "voltage": Logger.voltage_noise_v,
    "current": Logger.current_noise_a,
    "position": Logger.position_noise_m,
}

# How far a refit may take each constant, 1 sigma, relative: tight for the maker's Rm, Km, D.
REFIT = {"Rm": 0.03, "Km": 0.03, "D": 0.005, "Vmax": 0.03, "Rs": 1.0, "J": 0.3, "A": 0.3, "B": 0.3}
REFIT |= {"Kp": 0.3, "Ki": 0.3, "C": 0.5, "E": 0.3}
STEP = 1e-3  # of a constant, over which the change of a log is linear
INTEGRAL_STEP, INTEGRAL_SIGMA = 1e-4, 0.05  # of the error integral at the start [rad]
REFIT_ABSOLUTE = {"stop_low_m": 1e-3, "stop_high_m": 1e-3}


def scaled_log(spec: TruthSpec, until_s: float = np.inf):
    """The noiseless log up to a time as one vector, each channel in units of its noise."""
    frame, _ = make_log(without_noise(spec), 0)
    frame = frame[frame["time_s"] < until_s]
    channels = [frame[COLUMNS[channel]].to_numpy() / std for channel, std in NOISE.items()]
    return np.concatenate(channels)


def refit_directions(spec: TruthSpec):
    """Change of the log per prior sigma of each constant that a refit moves, one column each."""
    base = scaled_log(spec)
    columns = []
    for name, sigma in REFIT.items():
        value = getattr(spec.rig, name)
        moved = replace(spec, rig=replace(spec.rig, **{name: value * (1.0 + STEP)}))
        columns.append((scaled_log(moved) - base) / STEP * sigma)
    for name, sigma in REFIT_ABSOLUTE.items():
        moved = replace(spec, rig=replace(spec.rig, **{name: getattr(spec.rig, name) + 1e-6}))
        columns.append((scaled_log(moved) - base) / 1e-6 * sigma)
    turned = replace(spec, start_integral_rad=spec.start_integral_rad + INTEGRAL_STEP)
    columns.append((scaled_log(turned) - base) / INTEGRAL_STEP * INTEGRAL_SIGMA)
    zero_of_position = np.repeat([0.0, 0.0, 1e-3 / NOISE["position"]], base.size // 3)
    columns.append(zero_of_position)
    return np.column_stack(columns)


def nats_apart(
    one: TruthSpec, other: TruthSpec, spread: Mapping[str, float], until_s: float = np.inf
) -> float:
    """Nats between the log of `one` and that of the rig nearest to `other`'s with such constants, to first order.

    spread: 1 sigma of the constants that differ from rig to rig, relative; the integral at the start is in doubt as well. Half
    the squared distance in the noise of the channels, and half that of the constants in their spread.
    """
    base = scaled_log(other, until_s)
    columns = []
    for name, sigma in spread.items():
        moved = replace(other, rig=replace(other.rig, **{name: getattr(other.rig, name) * (1.0 + STEP)}))
        columns.append((scaled_log(moved, until_s) - base) / STEP * sigma)
    turned = replace(other, start_integral_rad=other.start_integral_rad + INTEGRAL_STEP)
    columns.append((scaled_log(turned, until_s) - base) / INTEGRAL_STEP * INTEGRAL_SIGMA)
    return 0.5 * beyond(scaled_log(one, until_s) - base, np.column_stack(columns)) ** 2


def beyond(shift, directions) -> float:
    """Norm of what directions, each with a prior of one, leave of a shift."""
    basis, _ = np.linalg.qr(np.vstack([directions, np.eye(directions.shape[1])]))
    padded = np.concatenate([shift, np.zeros(directions.shape[1])])
    return float(np.linalg.norm(padded - basis @ (basis.T @ padded)))


def visible_sigma(spec: TruthSpec, effects: tuple[Effect, ...], directions=None) -> float:
    """Norm of what the effects change in the log of `spec` and a refit with priors cannot absorb."""
    directions = refit_directions(spec) if directions is None else directions
    logged_profile = _pitched(spec.profile, fields_of(effects, "sensors").get("pitch_offset", 0.0))
    expected = scaled_log(replace(spec, effects=(), profile=logged_profile))
    shift = scaled_log(replace(spec, effects=effects)) - expected
    return beyond(shift, directions)


def detectable_factor(spec: TruthSpec, cause: str, directions=None, sigma: float = VISIBLE_SIGMA) -> float:
    """The size factor at which `cause` stands out by `sigma` in the log of `spec`; inf above 1000."""
    directions = refit_directions(spec) if directions is None else directions
    factor = 1.0
    for _ in range(8):
        seen = visible_sigma(spec, (sized_effect(cause, factor),), directions)
        if abs(seen / sigma - 1.0) < 0.02:
            return factor
        factor *= np.clip(sigma / max(seen, 1e-9), 1e-2, 1e2)
        if factor > 1e3:
            return np.inf
    return float(factor)


def _pitched(profile, offset_deg: float):
    return replace(
        profile, pitch_steps=tuple((start, pitch + offset_deg) for start, pitch in profile.pitch_steps)
    )
