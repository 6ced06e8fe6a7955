"""The hypotheses of a bank: a model, the states that observe it, and how a hypothesis is entered from another.

A fault is one override of the plant (`models.py`); a hypothesis adds the rig-to-rig spread as constants in the state,
so that the evidence integrates over it (docs/bank.md). Two hypotheses mix only the states whose names they share; a
state that the source does not have starts from its entry prior.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from observer_fi.bank import transition as tr
from observer_fi.errors import UsageError
from observer_fi.physics import INDEX, Model, Rig
from observer_fi.physics import rigs as models
from observer_fi.records import CHANNELS, Array
from observer_fi.settings import BankSettings

_KINDS = {"w": tr.W_STATE, "I": tr.I_STATE, "x": tr.X_STATE, "d": tr.D_STATE} | {
    "torque": tr.TORQUE,
    "rate": tr.RATE,
}


# A servo that nobody knows: i = Ki I is a random walk that the current sensor pins, without gains and limits.
FREE_SERVO = {"Kp": 0.0, "Ki": 1e-3, "Rs": 0.0, "Vmax": 1e6}


@dataclass(frozen=True)
class Hypothesis:
    """name; label of the verdict; the model; names of its states; channel (0, 1, 2) it does not believe, or -1."""

    name: str
    label: str
    model: Model
    states: tuple[str, ...]
    failed: int = -1

    @property
    def kinds(self) -> np.ndarray:
        """(n,) state codes of `transition.py`."""
        return np.array([_KINDS[s] if s in _KINDS else tr.SCALE + INDEX[s] for s in self.states])


def bank(rig: Rig, settings: BankSettings) -> tuple[Hypothesis, ...]:
    """The default bank on a rig: nominal, overload, coupling loss, none of these, and one failed sensor each.

    Raises UsageError for a rig that is driven by a force: its faults show in voltage and current.
    """
    if rig.drive == "force":
        raise UsageError(
            f'rig {rig.name!r} has drive = "force": faults are told from voltage, current and position; '
            "identify and improve take such a rig"
        )
    plant = rig.model if rig.has_servo else models.override(rig.model, rig.model.name, **FREE_SERVO)
    motion = ("w", "I", "x")
    spread = tuple(name for name in ("A", "B") if rig.spread(name) > 0.0) if settings.augment else ()
    inertia = (("J", "Vmax") if rig.has_servo else ("J",)) if settings.augment else ()
    contact = tuple(name for name in ("C", "E") if settings.augment and rig.spread(name) > 0.0)
    loose = tuple(name for name in ("A_decoupled",) if settings.augment and rig.spread(name) > 0.0)
    nominal = (*motion, *inertia, *spread)
    named = [
        Hypothesis("nominal", "nominal", plant, nominal),
        Hypothesis("overload", "overload", models.overload(plant), (*nominal, "d", *contact)),
        Hypothesis(
            "coupling_loss", "coupling_loss", models.coupling_loss(plant), (*motion, *inertia, *loose)
        ),
    ]
    if settings.unknown:
        free = ("torque", "rate")
        named.append(Hypothesis("unknown", "unknown", plant, (*motion, *inertia, *free)))
    if settings.sensors:
        named += [
            Hypothesis(f"sensor:{c}", "sensor_fault", plant, nominal, k) for k, c in enumerate(CHANNELS)
        ]
    return tuple(named)


SHARED = ("A", "B", "J", "Vmax")  # constants of the plant itself, whatever the hypothesis


class BankArrays(NamedTuple):
    """A bank as the arrays that the engines take; m hypotheses of at most n states.

    size (m,); layout (m, LAYOUT) of `transition.py`; parameters (m, VECTOR_SIZE); failed (m,);
    source (m, m, n): for target j, source i and state k of j the index of that state in i, or -1;
    entry_mean, entry_var (m, n): entry prior; diffusion (m, n) growth of the
    variance per second; rates (m, m) per second; noise (3,) variance of the channels;
    own (m, n) constants that the nominal hypothesis does not have.
    """

    size: np.ndarray
    layout: np.ndarray
    parameters: Array
    failed: np.ndarray
    source: np.ndarray
    entry_mean: Array
    entry_var: Array
    diffusion: Array
    rates: Array
    noise: Array
    own: np.ndarray


def arrays(hypotheses: tuple[Hypothesis, ...], rig: Rig, settings: BankSettings) -> BankArrays:
    """The arrays of a bank (see BankArrays)."""
    m, n = len(hypotheses), max(len(h.states) for h in hypotheses)
    size = np.array([len(h.states) for h in hypotheses])
    source = np.full((m, m, n), -1)
    mean, var, diffusion = np.zeros((m, n)), np.ones((m, n)), np.zeros((m, n))
    for j, target in enumerate(hypotheses):
        for k, state in enumerate(target.states):
            mean[j, k], var[j, k] = _entry(state, rig, settings)
            diffusion[j, k] = _diffusion(state, rig, settings)
            for i, origin in enumerate(hypotheses):
                if state in origin.states:
                    source[j, i, k] = origin.states.index(state)
    return BankArrays(
        size,
        np.array([tr.layout(h.kinds) for h in hypotheses]),
        np.array([tr.parameters_of(h.model) for h in hypotheses]),
        np.array([h.failed for h in hypotheses]),
        source,
        mean,
        var,
        diffusion,
        transition_rates(hypotheses, settings),
        rig.noise_std**2,
        own_constants(hypotheses, n),
    )


def own_constants(hypotheses: tuple[Hypothesis, ...], n: int) -> np.ndarray:
    """(m, n) whether a state is a constant of the plant that the first hypothesis does not have."""
    own = np.zeros((len(hypotheses), n), dtype=np.bool_)
    for j, h in enumerate(hypotheses):
        for k, state in enumerate(h.states):
            own[j, k] = state in INDEX and state not in hypotheses[0].states and state not in SHARED
    return own


def _entry(state: str, rig: Rig, settings: BankSettings) -> tuple[float, float]:
    """Mean and variance of a state when its hypothesis is entered from one that does not have it."""
    if state == "I" and not rig.has_servo:
        return 0.0, (rig.noise_std[1] / FREE_SERVO["Ki"]) ** 2
    if state in settings.entry_std:
        return 0.0, settings.entry_std[state] ** 2
    if state in settings.doubt:
        return 1.0, settings.doubt[state] ** 2
    return 1.0, rig.spread(state) ** 2


def _diffusion(state: str, rig: Rig, settings: BankSettings) -> float:
    if state == "I" and not rig.has_servo:
        return (settings.free_current / FREE_SERVO["Ki"]) ** 2
    if state in INDEX:
        return settings.wander.get(state, 0.0) ** 2
    return settings.diffusion.get(state, 0.0) ** 2


def transition_rates(hypotheses: tuple[Hypothesis, ...], settings: BankSettings) -> Array:
    """Generator of the mode process [1/s], (m, m): rows sum to zero, [i, j] is from i to j."""
    m = len(hypotheses)
    rates = np.full((m, m), settings.between_rate)
    rates[0, :] = settings.fault_rate
    for j, h in enumerate(hypotheses):
        rates[j, 0] = settings.recovery_rate if h.label == "overload" else 0.0
        if h.label in ("sensor_fault", "unknown"):
            rates[0, j] *= settings.rare
    np.fill_diagonal(rates, 0.0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    return rates
