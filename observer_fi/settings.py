"""Everything tunable, as frozen dataclasses, each number with its reason; and the reading and checking of TOML from people."""

import os
import stat
import tomllib
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from observer_fi.errors import UsageError, one_line

if TYPE_CHECKING:
    from pydantic import BaseModel

M = TypeVar("M", bound="BaseModel")

MOST_BYTES = 1 << 20  # a rig with an empirical curve has 10 kB


@dataclass(frozen=True)
class BankSettings:
    """The bank. Standard deviations by state name, SI units; wander is relative, per square root of a second.

    Currents, travels and integrals are those of the paper's rig; on another they count in proportion to its size.
    """

    augment: bool = True
    unknown: bool = True
    sensors: bool = True
    # Rates per second of the mode process: a fault in a thousand seconds of motion.
    fault_rate: float = 1e-3
    # The mass can leave an obstacle; no other fault heals within a move. At the next one it is mended with this probability.
    recovery_rate: float = 1e-4
    mended: float = 0.01
    between_rate: float = 1e-5
    rare: float = 0.1
    # Relative spread of constants that Table 1 gives none for but that differ between rigs, and from charge to charge.
    doubt: dict[str, float] = field(default_factory=lambda: {"J": 0.05, "Vmax": 0.03})
    # Prior of a state that a hypothesis has and its source has not. Those of a fault are in `FAULTS`, unless they are here.
    entry_std: dict[str, float] = field(default_factory=lambda: {"w": 1.0, "I": 0.05, "x": 1e-3})
    # Growth of the standard deviation per square root of a second. The same.
    diffusion: dict[str, float] = field(default_factory=lambda: {"w": 0.1, "I": 3e-5, "x": 5e-7})
    # The same for the current of a servo that nobody knows [A]: what a start changes in a sample is 10 mA.
    free_current: float = 0.4
    wander: dict[str, float] = field(default_factory=lambda: {"A": 0.002})
    # Share of that growth which moves the motor within its own interval: all of it in slow logs, whose intervals are long.
    meanwhile: float = 0.0
    # Timing of a sampled servo, as a share of the sample-to-sample change of a channel.
    timing: float = 0.1
    # Speed lost or won in a sample that parameters outside the state (gains, supply, winding) put in doubt, as a share.
    agility: float = 0.05
    # What a change of speed puts in doubt of the integral of a sampled servo [s]. Its delay, 60 us at 8 kHz, is one for all
    # samples of a start, so that their doubts add up straight: hence more than the delay itself.
    tick_s: float = 2e-4
    # A failed channel is off by a bias (relative to its noise on entry), repeats itself, or is noisy.
    bias_entry: float = 300.0
    bias_diffusion: float = 30.0
    repeat_weight: float = 0.2
    repeat_scale: float = 0.02
    noisy_weight: float = 0.1
    noisy_scale: float = 20.0
    # A glitch: farther than this many standard deviations, for at most so many samples.
    glitch_sigma: float = 8.0
    glitch_samples: int = 3
    # What one counts, as a normalised innovation squared: as much as the farthest reading that is none; less where a log is
    # seen to have spikes: one in a thousand readings, anywhere within a hundred standard deviations.
    glitch_nis: float = 64.0
    substep_s: float = 7e-4


@dataclass(frozen=True)
class DecisionSettings:
    """From probabilities to a verdict, the same for bank and mixture.

    Limits of the absolute test: on 300 simulated moves (docs/bank.md) the mean NIS of the right hypothesis over 0.1 s
    stays below 3.7 where 3 is expected, its own constants within 3.0 prior standard deviations, and the NIS of a stop
    and rest below 3.1.
    """

    isolated: float = 0.95
    # A fault that came and went is still one if it was certain for this long, and nominal was this far off: times its
    # expected NIS over window_s. Healthy rigs off by 3 % in five constants show at most 2.6 in a start.
    latch_s: float = 0.1
    # So long a fault must have been certain for the whole move to be asked about it.
    doubt_s: float = 0.01
    # Nats over nominal that a fault of the whole move must have, and the probability from which another label is as good.
    move_nats: float = 15.0
    alike: float = 0.01
    # Odds of a fault against none from which a stop makes the whole move be asked. Healthy ones stay below 1 in 1000.
    stop_odds: float = 0.01
    latch_nis: float = 4.0
    window_s: float = 0.1
    nis_limit: float = 2.0  # times the expected value
    strain_limit: float = 4.5
    rest_limit: float = 4.0  # times the expected value, and sensor hypotheses must explain it
    rest_evidence: float = 200.0  # nats that a sensor fault must win over a stop and rest
    onset_before_s: float = 0.6
    onset_after_s: float = 0.15


@dataclass(frozen=True)
class Settings:
    """All settings of the project."""

    bank: BankSettings = field(default_factory=BankSettings)
    decision: DecisionSettings = field(default_factory=DecisionSettings)


def load_settings(path: str | Path | None) -> Settings:
    """Settings of a TOML file with a table per dataclass, defaults where the file is silent.

    Raises UsageError for a key that does not exist, naming the right ones.
    """
    if path is None:
        return Settings()
    table = toml_table(path, "settings", "docs/bank.md")
    settings = Settings()
    try:
        for name, values in table.items():
            if name not in {f.name for f in fields(Settings)}:
                known = ", ".join(f.name for f in fields(Settings))
                raise UsageError(f"there are no settings {name!r} (known: {known})")
            settings = replace(settings, **{name: _changed(getattr(settings, name), name, values)})
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    return settings


# Shares and probabilities; every other number may be of any size from 0 on.
AT_MOST_ONE = ("mended", "between_rate", "rare", "repeat_weight", "noisy_weight", "isolated", "meanwhile")


def _changed(group: Any, name: str, values: Any) -> Any:
    """The group with what the file gives, each value of its default's type. Raises UsageError: a key, a type, a range."""
    if not isinstance(values, dict):
        raise UsageError(f"{name} must be a table, got {values!r:.80}")
    known = {f.name for f in fields(group)}
    for key in values:
        if key not in known:
            raise UsageError(f"there is no setting {key!r} (known: {', '.join(sorted(known))})")
    try:
        given = checked(_model(type(group)), values).model_dump(exclude_unset=True)
    except UsageError as error:
        raise UsageError(f"{name}.{error}") from error
    defaults = {key: getattr(group, key) for key in given}
    return replace(
        group, **{key: defaults[key] | v if isinstance(v, dict) else v for key, v in given.items()}
    )


def _model(group: type) -> Any:
    """The pydantic model of a group: finite numbers from 0 on, shares up to 1, no text and no truth value for a number."""
    from pydantic import ConfigDict, Field, create_model

    def of(name: str, kind: Any) -> Any:
        limited = Field(ge=0.0, le=1.0 if name in AT_MOST_ONE else 1e12, allow_inf_nan=False)
        return {
            float: Annotated[float, limited], dict[str, float]: dict[str, Annotated[float, limited]],
            int: Annotated[int, Field(ge=0, le=10**6)],
        }.get(kind, kind)  # fmt: skip

    members: Any = {f.name: (of(f.name, f.type), None) for f in fields(group)}
    return create_model(group.__name__, __config__=ConfigDict(strict=True), **members)


def toml_table(path: str | Path, what: str, example: str) -> dict[str, Any]:
    """The table of a TOML file. what: "rig file", ...; example: where files of this kind are. Raises UsageError."""
    advice = f"give a TOML file as in {example}"
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise UsageError(f"{path}: cannot read the {what} (not a file); {advice}")
        with open(path, "rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        if isinstance(error, UsageError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"{path}: cannot read the {what} ({reason}); {advice}") from error
    if len(raw) > MOST_BYTES:
        raise UsageError(f"{path}: cannot read the {what} (more than {MOST_BYTES >> 20} MB); {advice}")
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except RecursionError as error:
        raise UsageError(f"{path}: not a TOML file: nested too deeply") from error
    except ValueError as error:  # of TOML, of UTF-8, of numbers with more than 4300 digits
        raise UsageError(f"{path}: not a TOML file: {error}") from error


def checked(model: type[M], table: dict[str, Any]) -> M:
    """The table as a pydantic model. Raises UsageError: the key, what is wrong with it, and what was given."""
    import pydantic

    try:
        return model.model_validate(table)
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False, include_context=True)[0]
        raise UsageError(_said(dict(first))) from error
    except RecursionError as error:
        raise UsageError("tables are nested too deeply") from error


def _said(error: dict[str, Any]) -> str:
    """One line of an error of pydantic: "noise.voltage must be greater than 0, got nan"."""
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])  # a sentence of our own, which names its key
    if error["type"] == "missing":
        return f"{key} is missing"
    text = _IN_OUR_WORDS.get(error["type"]) or error["msg"].removeprefix("Input should be ")
    return f"{key} must be {text}, got {one_line(repr(error['input']), 80)}"


_IN_OUR_WORDS = {
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "dict_type": "a table",
    "list_type": "a list",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dataclass_type": "a table",
}
