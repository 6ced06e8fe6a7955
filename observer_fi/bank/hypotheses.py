"""The hypotheses of a bank: a model, the states that observe it, and how a hypothesis is entered from another.

A fault is one row of `FAULTS`; a hypothesis adds the rig-to-rig spread as constants in the state,
so that the evidence integrates over it (docs/bank.md). Two hypotheses mix only the states whose names they share; a
state that the source does not have starts from its entry prior.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.bank import transition as tr
from observer_fi.bank.rig_scale import Scale, scale_of
from observer_fi.errors import UsageError
from observer_fi.physics import (
    FAULTS,
    INDEX,
    NOMINAL,
    UNKNOWN,
    FaultRow,
    Model,
    OwnState,
    Rig,
    channel_of,
    faulty,
    override,
)
from observer_fi.records import CHANNELS, Array
from observer_fi.settings import BankSettings

MOTION = ("w", "I", "x")
_KINDS = {"w": tr.W_STATE, "I": tr.I_STATE, "x": tr.X_STATE, "d": tr.D_STATE} | {
    "torque": tr.TORQUE,
    "rate": tr.RATE,
}


@dataclass(frozen=True)
class Hypothesis:
    """name; label of the verdict; the model; names of its states; channel (0, 1, 2) it does not believe, or -1.

    own: what its fault says of the states that it adds; kept: what an earlier fault says of those that it left behind.
    """

    name: str
    label: str
    model: Model
    states: tuple[str, ...]
    failed: int = -1
    own: tuple[OwnState, ...] = ()
    kept: tuple[OwnState, ...] = ()

    @property
    def kinds(self) -> np.ndarray:
        """(n,) state codes of `transition.py`."""
        return np.array([_KINDS[s] if s in _KINDS else tr.SCALE + INDEX[s] for s in self.states])


def bank(rig: Rig, settings: BankSettings) -> tuple[Hypothesis, ...]:
    """The default bank on a rig: the hypotheses of every row of `FAULTS`.

    Raises UsageError for a rig that no motor drives: its faults show in voltage and current.
    """
    if not rig.driven.motor:
        raise UsageError(
            f'rig {rig.name!r} has drive = "{rig.drive}": faults are told from voltage, current and position; '
            "identify and improve take such a rig"
        )
    plant = override(rig.model, NOMINAL, **rig.watched.plant)
    rows = [row for row in FAULTS.values() if row.live and _wanted(row, settings)]
    return tuple(h for row in rows for h in _hypotheses(row, row.states, plant, rig, settings))


def of_a_move(rig: Rig, settings: BankSettings) -> tuple[Hypothesis, ...]:
    """What a whole move is compared with: every row of `FAULTS`, at any severity."""
    plant = override(rig.model, NOMINAL, **rig.watched.plant)
    wanted = [row for row in FAULTS.values() if _wanted(row, settings)]
    parts = [(row, sizes) for row in wanted for sizes in itertools.product(*map(_gaussians, row.sizes))]
    return tuple(h for row, sizes in parts for h in _hypotheses(row, sizes, plant, rig, settings))


def on_top(first: Hypothesis, h: Hypothesis) -> Hypothesis:
    """A fault that comes on top of another one: a nut that slips goes on to slip while friction rises.

    Alone where nothing of the first one is left, the motor turning without the mass, and where both are about one constant.
    """
    names = {own.name for own in first.own}
    if not FAULTS[h.label].shares or not names or names & {own.name for own in h.own}:
        return h
    absolute = {own.name: own.mean for own in first.own if own.absolute}
    model = override(h.model, h.label, **FAULTS[first.label].plant, **absolute)
    return replace(h, model=model, states=(*h.states, *(own.name for own in first.own)), kept=first.own)


def other_laws(rig: Rig, settings: BankSettings) -> tuple[Hypothesis, ...]:
    """The faults of `of_a_move` by the other laws that they may follow."""
    plant = override(rig.model, NOMINAL, **rig.watched.plant)
    laws = [(row, law) for row in FAULTS.values() for law in row.laws]
    return tuple(
        h
        for row, law in laws
        for h in _hypotheses(row, law.sizes, override(plant, NOMINAL, **law.plant(plant)), rig, settings)
    )


def _gaussians(own: OwnState) -> tuple[OwnState, ...]:
    """The Gaussians that the prior of a fault's constant, and of its growth, is made of."""
    pairs = itertools.product(own.means or (own.mean,), own.growths or (own.growth,))
    usual = tuple(own._replace(mean=mean, growth=growth) for mean, growth in pairs)
    if own.creeps is None:
        return usual
    mean, std, growth = own.creeps
    return (*usual, own._replace(mean=mean, std=std, growth=growth))


def _wanted(row: FaultRow, settings: BankSettings) -> bool:
    return settings.sensors if row.by_channel else settings.unknown if row.label == UNKNOWN else True


def _hypotheses(
    row: FaultRow, added: tuple[OwnState, ...], plant: Model, rig: Rig, settings: BankSettings
) -> list[Hypothesis]:
    """Those of a fault, with the states that the rig's spread asks for."""
    constants = (*rig.watched.in_doubt, *(name for name in row.shares if rig.spread(name) > 0.0))
    own = [s for s in added if s.std is not None or (settings.augment and rig.spread(s.name) > 0.0)]
    states = (*MOTION, *(constants if settings.augment else ()), *(s.name for s in own))
    absolute = {s.name: s.mean for s in own if s.absolute}  # what a factor of 1 then is
    model = override(faulty(plant, row.label), row.label, **absolute)
    return [Hypothesis(mode, row.label, model, states, _channel(mode), tuple(own)) for mode in row.modes]


def _channel(mode: str) -> int:
    channel = channel_of(mode)
    return -1 if channel is None else CHANNELS.index(channel)


class BankArrays(NamedTuple):
    """A bank as the arrays that the engines take; m hypotheses of at most n states.

    size (m,); layout (m, LAYOUT) of `transition.py`; parameters (m, VECTOR_SIZE); failed (m,);
    source (m, m, n): for target j, source i and state k of j the index of that state in i, or -1;
    entry_mean, entry_var (m, n): entry prior; diffusion (m, n) growth of the
    variance per second; rates (m, m) per second; noise (3,) variance of the channels, repeat (3,) how far a
    reading that repeats itself may be from the one before, as a share of its standard deviation;
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
    repeat: Array
    own: np.ndarray


def arrays(hypotheses: tuple[Hypothesis, ...], rig: Rig, settings: BankSettings) -> BankArrays:
    """The arrays of a bank (see BankArrays)."""
    m, n = len(hypotheses), max(len(h.states) for h in hypotheses)
    size = np.array([len(h.states) for h in hypotheses])
    source = np.full((m, m, n), -1)
    mean, var, diffusion = np.zeros((m, n)), np.ones((m, n)), np.zeros((m, n))
    scale = scale_of(rig.model)
    for j, target in enumerate(hypotheses):
        for k, state in enumerate(target.states):
            mean[j, k], var[j, k] = _entry(target, state, rig, settings, scale)
            diffusion[j, k] = _diffusion(target, state, rig, settings, scale)
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
        transition_rates(hypotheses, settings, _absent(rig)),
        rig.noise_std**2,
        repeat_share(rig, settings),
        own_constants(hypotheses, n),
    )


def _absent(rig: Rig) -> tuple[int, ...]:
    """Channels of which the logger of a rig shows none."""
    if rig.logger is None:
        return ()
    return () if math.isfinite(rig.logger.voltage.as_white) else (CHANNELS.index("voltage"),)


REPEATING = 0.1  # share of readings at rest that repeat themselves, from which that says nothing of a sensor
# Times the share of readings that repeat themselves by chance: a density as narrow as that has at a repeat what chance says.
BY_CHANCE = math.sqrt(math.e)
SLACK = (
    0.5  # nats that a repeat may gain beyond what chance allows: how often readings repeat is known to that
)
NO_NEWS = 1e6  # standard deviations, within which a reading is said to repeat itself where that says nothing
WITHIN_STEP = 0.4  # of a step: readings that repeat themselves within it are as dense as a step allows


def repeat_share(rig: Rig, settings: BankSettings) -> Array:
    """(3,) how far a reading that repeats itself may be from the one before, as a share of its standard deviation.

    Of what noise alone changes, whatever hum or colour there is beside it; of coarse readings within their step. What an unknown
    servo makes of voltage and current nothing foretells as well as such a repeat would have to be.
    """
    fine = settings.repeat_scale * rig.neighbour_std
    chance = BY_CHANCE * rig.repeats * rig.neighbour_std
    share = np.maximum.reduce((fine, WITHIN_STEP * rig.step, chance)) / rig.noise_std
    share = np.where(_usual(share, rig), 1.0, share)
    if rig.watched.servo:
        return np.where((rig.repeats > REPEATING) & (rig.step == 0.0), 1.0, share)
    alone = np.array([False, "voltage_v" not in rig.watched.columns, False])
    return np.where((rig.repeats > REPEATING) | alone, (NO_NEWS, NO_NEWS, 1.0), share)


def _usual(share: Array, rig: Rig) -> NDArray[np.bool_]:
    """(3,) whether a reading as close to the one before as `share` (3,) of its standard deviation is no news.

    Noise that wanders, or hum, is taken for white noise of its density: beside that every reading is close to the one before,
    and one that repeats it by chance gains more than chance allows.
    """
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # readings without noise, or that never repeat themselves
        gained = -np.log(np.minimum(share, 1.0))
        chance = np.log(BY_CHANCE * rig.repeats)
        apart = (rig.neighbour_std / (share * rig.noise_std)) ** 2
    return np.asarray((gained > apart) | (gained + chance > SLACK), dtype=np.bool_)


def own_constants(hypotheses: tuple[Hypothesis, ...], n: int) -> np.ndarray:
    """(m, n) whether a state is a constant of the plant that the fault adds and the first hypothesis does not have."""
    own = np.zeros((len(hypotheses), n), dtype=np.bool_)
    for j, h in enumerate(hypotheses):
        for k, state in enumerate(h.states):
            own[j, k] = state in INDEX and state not in hypotheses[0].states and _own(h, state) is not None
    return own


def _own(h: Hypothesis, state: str) -> OwnState | None:
    """What a fault says of a state that it adds, its own or one of the fault before it; None where the state is of neither."""
    return next((s for s in (*h.own, *h.kept) if s.name == state), None)


def _entry(h: Hypothesis, state: str, rig: Rig, settings: BankSettings, scale: Scale) -> tuple[float, float]:
    """Mean and variance of a state when its hypothesis is entered from one that does not have it."""
    if state == "I" and not rig.watched.servo:
        return 0.0, (rig.noise_std[1] / h.model["Ki"]) ** 2
    own = _own(h, state)
    spread = math.hypot(max(settings.doubt.get(state, 0.0), rig.spread(state)), _uncertain(rig, state))
    mean, usual = (own.mean, own.std) if own else (float(state in INDEX), None)
    unit = _unit(own, rig, scale)
    if state in settings.entry_std:
        return mean * unit, (settings.entry_std[state] * scale.of(state)) ** 2
    if usual is None:
        return mean * unit, spread**2
    return mean * unit, (
        max(usual * unit, rig.spread(state)) if usual else 0.0
    ) ** 2  # a width of 0: a known constant


def _uncertain(rig: Rig, name: str) -> float:
    """Relative standard error of a constant that was learned, 0 of others."""
    q = rig.quantities.get(name)
    return abs(q.std / q.value) if q is not None and q.std is not None and q.value else 0.0


def _unit(own: OwnState | None, rig: Rig, scale: Scale) -> float:
    """What turns the numbers of a fault's state into those of the filters."""
    if own is None:
        return 1.0
    return 1.0 / own.mean if own.absolute else rig.model["A"] if own.of_friction else scale.of(own.name)


def _diffusion(h: Hypothesis, state: str, rig: Rig, settings: BankSettings, scale: Scale) -> float:
    """Growth of the variance of a state per second."""
    if state == "I" and not rig.watched.servo:
        return (settings.free_current * scale.current / h.model["Ki"]) ** 2
    if state in settings.diffusion:
        return (settings.diffusion[state] * scale.of(state)) ** 2
    own = _own(h, state)
    growth = own.growth * _unit(own, rig, scale) if own else 0.0
    return growth**2 + settings.wander.get(state, 0.0) ** 2


NEVER = 1e-12  # of a rate, for what cannot happen


def transition_rates(
    hypotheses: tuple[Hypothesis, ...], settings: BankSettings, absent: tuple[int, ...] = ()
) -> Array:
    """Generator of the mode process [1/s], (m, m): rows sum to zero, [i, j] is from i to j.

    absent: channels that are not there. Their sensors do not fail: it would be a second nominal hypothesis, from which no
    reading comes back.
    """
    m = len(hypotheses)
    rates = np.full((m, m), settings.between_rate)
    rates[0, :] = settings.fault_rate
    for j, h in enumerate(hypotheses):
        row = FAULTS.get(h.label)
        rates[j, 0] = settings.recovery_rate if row and row.heals else 0.0
        if row and row.rare:
            rates[0, j] *= settings.rare
        if h.failed in absent:
            rates[:, j] *= NEVER
    np.fill_diagonal(rates, 0.0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    return rates
