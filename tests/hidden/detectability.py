"""How visible a hidden effect is, once a refit of the rig has hidden what it can of it: a linear study.

The unit is one standard deviation of white noise over the whole log: 5 is the limit of a perfect analyst. One
who must choose among thirty causes with correlated residuals needs some 20, and a sampled servo that is
modelled as a continuous one leaves about 200 itself, 65 of them after a fitted delay and lag.
"""

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
REFIT_ABSOLUTE = {"stop_low_m": 1e-3, "stop_high_m": 1e-3}


def scaled_log(spec: TruthSpec):
    """The noiseless log as one vector, each channel in units of its noise."""
    frame, _ = make_log(without_noise(spec), 0)
    channels = [frame[COLUMNS[channel]].to_numpy() / std for channel, std in NOISE.items()]
    return np.concatenate(channels)


def refit_directions(spec: TruthSpec):
    """Change of the log per prior sigma of each constant that a refit moves, one column each."""
    base = scaled_log(spec)
    columns = []
    for name, sigma in REFIT.items():
        value = getattr(spec.rig, name)
        moved = replace(spec, rig=replace(spec.rig, **{name: value * 1.001}))
        columns.append((scaled_log(moved) - base) / 0.001 * sigma)
    for name, sigma in REFIT_ABSOLUTE.items():
        moved = replace(spec, rig=replace(spec.rig, **{name: getattr(spec.rig, name) + 1e-6}))
        columns.append((scaled_log(moved) - base) / 1e-6 * sigma)
    turned = replace(spec, start_integral_rad=spec.start_integral_rad + 1e-4)
    columns.append((scaled_log(turned) - base) / 1e-4 * 0.05)
    zero_of_position = np.repeat([0.0, 0.0, 1e-3 / NOISE["position"]], base.size // 3)
    columns.append(zero_of_position)
    return np.column_stack(columns)


def visible_sigma(spec: TruthSpec, effects: tuple[Effect, ...], directions=None) -> float:
    """Norm of what the effects change in the log of `spec` and a refit with priors cannot absorb."""
    directions = refit_directions(spec) if directions is None else directions
    logged_profile = _pitched(spec.profile, fields_of(effects, "sensors").get("pitch_offset", 0.0))
    expected = scaled_log(replace(spec, effects=(), profile=logged_profile))
    shift = scaled_log(replace(spec, effects=effects)) - expected
    priors = np.eye(directions.shape[1])
    basis, _ = np.linalg.qr(np.vstack([directions, priors]))
    padded = np.concatenate([shift, np.zeros(len(priors))])
    return float(np.linalg.norm(padded - basis @ (basis.T @ padded)))


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
