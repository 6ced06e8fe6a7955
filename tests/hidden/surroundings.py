"""The same actuator on another day: what varies around it without being a fault.

    surroundings = SURROUNDINGS["warm winding"]
    frame, truth = log_in(surroundings, draw_move_case(3, "nominal"), 3)
    specs = healthy_days(surroundings, 3)               # three campaigns, from a usual day to this one

Each is a change of the truth of plant.py, of its pitch or of its inclinometer; nothing of it is in the log but by its effect.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from .effects import Effect
from .profiles import campaign
from .rig import draw_rig
from .truth import TruthSpec, make_log

COPPER = 0.0039  # 1/K, by which a winding's resistance grows
OF_FRICTION = 0.03


@dataclass(frozen=True)
class Surroundings:
    """name; change: of the truth of a move, by a share of it (0 none, 1 all), with a generator for phases; late_s: of the
    inclinometer [s].
    """

    name: str
    change: Callable[[TruthSpec, float, np.random.Generator], TruthSpec]
    late_s: float = 0.0


def _scaled(**by: float) -> Callable[[TruthSpec, float, np.random.Generator], TruthSpec]:
    """Constants of the rig by 1 + share * by."""

    def change(spec: TruthSpec, share: float, rng: np.random.Generator) -> TruthSpec:
        values = {name: getattr(spec.rig, name) * (1.0 + share * more) for name, more in by.items()}
        return replace(spec, rig=replace(spec.rig, **values))

    return change


def _with_ripple(cause: str, **fixed: float) -> Callable[[TruthSpec, float, np.random.Generator], TruthSpec]:
    """A torque of 3 % of the friction that comes and goes."""

    def change(spec: TruthSpec, share: float, rng: np.random.Generator) -> TruthSpec:
        values = {
            "amplitude": share * OF_FRICTION * spec.rig.A,
            "phase": rng.uniform(0.0, 2.0 * np.pi),
            **fixed,
        }
        return replace(spec, effects=(*spec.effects, Effect(cause, tuple(values.items()))))

    return change


def _pitching(deg: float, hz: float) -> Callable[[TruthSpec, float, np.random.Generator], TruthSpec]:
    """A vehicle that pitches."""

    def change(spec: TruthSpec, share: float, rng: np.random.Generator) -> TruthSpec:
        phase = rng.uniform(0.0, 2.0 * np.pi)
        pitched = replace(spec.profile, pitch_wave_deg=share * deg, pitch_wave_hz=hz, pitch_wave_phase=phase)
        return replace(spec, profile=pitched)

    return change


def _stepping(spec: TruthSpec, share: float, rng: np.random.Generator) -> TruthSpec:
    """A pitch that steps by 5 deg in the middle of a move."""
    steps = list(spec.profile.pitch_steps)
    middle = [m.start_s + 0.5 * m.hold_s for m in spec.profile.moves]
    for at in middle:
        before = [level for start, level in steps if start <= at]
        steps.append((at, before[-1] + share * 5.0))
    return replace(spec, profile=replace(spec.profile, pitch_steps=tuple(sorted(steps))))


def _both(*changes: Callable) -> Callable[[TruthSpec, float, np.random.Generator], TruthSpec]:
    def change(spec: TruthSpec, share: float, rng: np.random.Generator) -> TruthSpec:
        for one in changes:
            spec = one(spec, share, rng)
        return spec

    return change


_WARM = _scaled(Rm=30.0 * COPPER)
_SWELL = _with_ripple("slow_torque", frequency=1.1)
_MORE_FRICTION = _scaled(A=0.3, A_loose=0.3)

SURROUNDINGS = {
    one.name: one
    for one in (
        Surroundings("usual", _scaled()),
        Surroundings("winding 30 K warmer", _WARM),
        Surroundings("supply 12 % lower", _scaled(Vmax=-0.12)),
        Surroundings("supply 10 % higher", _scaled(Vmax=0.1)),
        Surroundings("gains 20 % higher", _scaled(Kp=0.2, Ki=0.2)),
        Surroundings("inertia 15 % more", _scaled(J=0.15, J_loose=0.15)),
        Surroundings("friction 30 % more", _MORE_FRICTION),
        Surroundings("friction 25 % less", _scaled(A=-0.25, A_loose=-0.25)),
        Surroundings("torque swells, 3 % at 1.1 Hz", _SWELL),
        Surroundings("ripple of the screw, 3 %", _with_ripple("screw_ripple")),
        Surroundings("ripple of the shaft, 3 %", _with_ripple("shaft_ripple", order=1.0)),
        Surroundings("pitch surges, 8 deg at 0.3 Hz", _pitching(8.0, 0.3)),
        Surroundings("pitch steps by 5 deg", _stepping),
        Surroundings("inclinometer 0.3 s late", _pitching(3.0, 0.3), late_s=0.3),
        Surroundings("warm winding, swell", _both(_WARM, _SWELL)),
        Surroundings("low supply, more friction", _both(_scaled(Vmax=-0.12), _MORE_FRICTION)),
    )
}


def log_in(
    surroundings: Surroundings, spec: TruthSpec, seed: int, share: float = 1.0
) -> tuple[pd.DataFrame, dict]:
    """A log of a move in these surroundings, and its truth."""
    rng = np.random.default_rng([seed, 17])
    frame, truth = make_log(surroundings.change(spec, share, rng), seed)
    late = round(share * surroundings.late_s * spec.logger.rate_hz)
    if late:
        frame["pitch_deg"] = frame["pitch_deg"].shift(late).bfill()
    return frame, truth


def healthy_days(surroundings: Surroundings, seed: int) -> list[pd.DataFrame]:
    """Three healthy campaigns of one rig, on a usual day, on one half way to these surroundings, and in them."""
    rig = draw_rig(np.random.default_rng([seed, 18]))
    spec = TruthSpec(campaign(), rig)
    return [log_in(surroundings, spec, seed + k, share)[0] for k, share in enumerate((0.0, 0.5, 1.0))]
