"""What is to be told apart: causes with their sizes, one cause and none, or two faults; each as models that a fit may take."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from observer_fi.errors import UsageError
from observer_fi.improve import base_parameters, free_of, start_values
from observer_fi.learn import Free
from observer_fi.physics import (
    CAUSES,
    FAULT_KINDS,
    MOVES,
    PARAMETERS,
    Coverage,
    Fault,
    Model,
    Rig,
    Variant,
    broken,
    override,
    unknown_name,
)
from observer_fi.records import CHANNELS

NONE = "none"
SENSOR = "sensor_fault"
_LIMIT_SHARES = (0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2)  # of what a limit would leave alone
_LEAST_DOUBT = 0.02  # relative: of constants whose spread the rig file does not give


@dataclass(frozen=True)
class Hypothesis:
    """One form of a rival. model: the rig with it, at its size. free: what a fit of it moves.

    still: the channel that shows nothing but its first reading, of `CHANNELS`' order; None where all show what there is.
    """

    form: str
    model: Model
    free: tuple[Free, ...]
    still: int | None = None


@dataclass(frozen=True)
class Rival:
    """forms: the first is what the logs are simulated with. fault: how it is simulated; of a cause, the values do that.

    within_all: whether every other rival holds it as a special case, as a cause does its absence.
    """

    name: str
    values: Mapping[str, float]
    forms: tuple[Hypothesis, ...]
    fault: Fault = Fault()
    within_all: bool = False


Asked = tuple[str, Mapping[str, float]]


def parse(text: str) -> list[Asked]:
    """cause[:parameter=value[;parameter=value]...],... as names and given values. Raises UsageError."""
    asked: list[Asked] = []
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, rest = part.partition(":")
        values = {}
        for item in filter(None, rest.split(";")):
            parameter, _, number = item.partition("=")
            try:
                values[parameter.strip()] = float(number)
            except ValueError:
                raise UsageError(f"--between: {item!r} of {name} is not PARAMETER=NUMBER") from None
            if not math.isfinite(values[parameter.strip()]):
                raise UsageError(f"--between: {item!r} of {name} is not a finite number")
        asked.append((name.strip(), values))
    return asked


def asked_by(path: Path) -> list[Asked]:
    """The first finding of an improve.json that has rivals, or the first, with its size, and its rivals. Raises UsageError."""
    try:
        findings = json.loads(path.read_text(encoding="utf-8"))["findings"]
        each = [
            (str(f["cause"]), _sizes(f), [str(name) for name in f["indistinguishable_from"]])
            for f in findings
        ]
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise UsageError(f"{path}: this is not an improve.json of observer-fi improve") from None
    if not each:
        raise UsageError(f"{path}: improve found no cause, so there are no rivals; name them with --between")
    cause, values, rivals = next((f for f in each if f[2]), each[0])
    return [(cause, values), *((name, {}) for name in rivals)]


def _sizes(finding: dict[str, Any]) -> dict[str, float]:
    return {str(name): float(p["value"]) for name, p in finding["parameters"].items()}


def checked(asked: Sequence[Asked], option: str = "--between") -> list[Asked]:
    """The causes, with `none` beside a single one. Raises UsageError for names that do not exist or stand twice."""
    names = [name for name, _ in asked]
    for name in names:
        if name != NONE and name not in CAUSES:
            raise unknown_name(name, (*CAUSES, NONE), "cause")
    if len(set(names)) < len(names) or not set(names) - {NONE}:
        raise UsageError(
            f"{option}: two different causes or more are needed, or one, got {', '.join(names) or 'none'}"
        )
    return [*asked, (NONE, {})] if len(names) == 1 else list(asked)


def aliases(names: Sequence[str]) -> tuple[str, str] | None:
    """Two of the causes that move the readings in exactly the same way, on any move."""
    for k, first in enumerate(names):
        for second in names[k + 1 :]:
            if (
                NONE not in (first, second)
                and second in CAUSES[first].aliases
                and first in CAUSES[second].aliases
            ):
                return first, second
    return None


# --- causes ------------------------------------------------------------------------------------------


def forms_of(cause: str, given: Mapping[str, float], coverage: Coverage) -> tuple[Variant, ...]:
    """The forms of a cause, the one that the given values mean first. Raises UsageError where there is none."""
    if "gear_order" in given:
        coverage = coverage._replace(orders=(given["gear_order"],))
    own = CAUSES[cause].variants(coverage, MOVES)
    same = (CAUSES[name].variants(coverage, MOVES) for name in CAUSES[cause].aliases)
    forms = own or next((forms for forms in same if forms), ())
    if not forms:
        hint = "; give gear_order" if cause == "gear_ripple" else ""
        raise UsageError(
            f"--between: {cause} does not show on this rig, or another name stands for it there{hint}"
        )
    fitting = [v for v in forms if set(given) <= _names(v)]
    if not fitting:
        known = sorted(set().union(*map(_names, forms)))
        raise UsageError(
            f"--between: no form of {cause} has {', '.join(given)}; its parameters are {', '.join(known)}"
        )
    first = min(fitting, key=lambda v: _distance(v, given))
    return (first, *(v for v in forms if v is not first))


def _names(variant: Variant) -> set[str]:
    return {t.parameter for t in variant.terms} | {name for name, _ in variant.fixed}


def _distance(variant: Variant, given: Mapping[str, float]) -> float:
    """How far the shapes of a form are from given ones, relative."""
    there = start_values(variant)
    return sum(abs(given[n] / there[n] - 1.0) for n in given if n in variant.shapes and there[n])


def hypothesis(rig: Rig, variant: Variant, values: Mapping[str, float]) -> Hypothesis:
    """A form of a cause at these values, everything that `improve` refits free beside it."""
    terms = {t.parameter: t for t in variant.terms}
    inside = {n: min(max(v, terms[n].low), terms[n].high) if n in terms else v for n, v in values.items()}
    model = override(rig.model, rig.model.name, **inside)
    own = tuple(
        _widened(free, values[free.name]) if free.name in values else free for free in free_of(variant)
    )
    names = {free.name for free in own}
    return Hypothesis(
        variant.name, model, (*(f for f in base_parameters(rig, rig.model) if f.name not in names), *own)
    )


def _widened(free: Free, value: float) -> Free:
    """The parameter with bounds that hold a value that somebody gave."""
    return free._replace(low=min(free.low, value), high=max(free.high, value))


def sized(variant: Variant, given: Mapping[str, float], times: float) -> dict[str, float]:
    """Values of a form: those given, the other sizes neutral; without a given size, all sizes at so many times their start."""
    values = start_values(variant)
    anything = any(t.parameter in given for t in variant.sizes)
    for term in variant.sizes:
        if math.isfinite(term.neutral):
            size = term.neutral + times * (term.start - term.neutral)
            values[term.parameter] = term.neutral if anything else min(max(size, term.low), term.high)
    return {**values, **given}


def is_limit(variant: Variant) -> bool:
    """Whether its size is a limit that nothing reaches where it is neutral."""
    return not all(math.isfinite(term.neutral) for term in variant.sizes)


def holds_neutral(variant: Variant) -> bool:
    """Whether a fit of it can do as if it were not there."""
    return all(t.low <= t.neutral <= t.high and math.isfinite(t.neutral) for t in variant.sizes)


def limit_values(variant: Variant) -> list[dict[str, float]]:
    """Sizes of a limit, from hardly felt to gross."""
    names = [t.parameter for t in variant.sizes]
    start = start_values(variant)
    return [{**start, **{n: share * start[n] for n in names}} for share in _LIMIT_SHARES]


def no_cause(rig: Rig) -> Rival:
    """The rig as its file has it."""
    return Rival(NONE, {}, (Hypothesis("", rig.model, base_parameters(rig, rig.model)),), within_all=True)


# --- faults ------------------------------------------------------------------------------------------


def faults_of(text: str, rig: Rig) -> list[Rival]:
    """Faults that are there when the log begins: coupling_loss, jam, ..., sensor_fault:CHANNEL (a frozen one), none.

    Raises UsageError.
    """
    names = [p.strip() for p in text.split(",") if p.strip()]
    if len(set(names)) < 2 or len(set(names)) < len(names):
        raise UsageError(
            f"--faults: two different faults or more are needed, got {', '.join(names) or 'none'}"
        )
    return [_fault(name, rig) for name in names]


def _fault(text: str, rig: Rig) -> Rival:
    name, _, channel = text.partition(":")
    free = _in_doubt(rig)
    if name == NONE:
        return Rival(NONE, {}, (Hypothesis("", rig.model, free),))
    if name == SENSOR:
        if channel not in CHANNELS:
            raise UsageError(
                f"--faults: {text!r} needs a channel, as {SENSOR}:{CHANNELS[-1]}; there are {', '.join(CHANNELS)}"
            )
        still = Hypothesis("frozen", rig.model, free, CHANNELS.index(channel))
        return Rival(text, {}, (still,), Fault("sensor_frozen", 0.0, channel))
    changing = tuple(k for k in FAULT_KINDS if Fault(k).changes_plant)
    if name not in changing:
        raise unknown_name(name, (*changing, SENSOR, NONE), "fault")
    model = broken(rig.model, name, 0.0, True)
    changed = {
        n: v for n, v in zip(PARAMETERS, model.values, strict=False) if v != rig.model[n] and math.isfinite(v)
    }
    return Rival(text, changed, (Hypothesis(name, model, free),), Fault(name))


def _in_doubt(rig: Rig) -> tuple[Free, ...]:
    """What a verdict leaves open: the constants within their spread from rig to rig."""
    own = tuple(f for f in base_parameters(rig, rig.model))
    extra = [n for n in ("A_decoupled", "J_decoupled") if rig.model[n] > 0.0]
    loose = (
        Free(n, 1e-3 * rig.model[n], 0.1 * rig.model[n], 10.0 * rig.model[n], rig.model[n]) for n in extra
    )
    return tuple(_as_known(f, rig) for f in (*own, *loose))


def _as_known(free: Free, rig: Rig) -> Free:
    if not free.prior:
        return free
    std = max(rig.spread(free.name), _LEAST_DOUBT) * abs(free.prior)
    return free._replace(prior_std=min(std, free.prior_std))
