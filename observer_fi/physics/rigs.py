"""A model is a name and the parameters of the equations; a fault is one override (`faults.py`), an effect a changed term.

Rigs are TOML files: values with unit, how they were found, their spread from rig to rig, and how the actuator is driven.
"""

import difflib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
import tomli_w

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.numerics import filled
from observer_fi.physics import empirical_curve as curves
from observer_fi.physics import rig_file
from observer_fi.physics.drives import DRIVES, SERVOS_OWN, CommandLaw, Drive
from observer_fi.physics.empirical_curve import Curve, curve_of, is_curve
from observer_fi.physics.equations import EXTENDED, INDEX, NAMES, PARAMETERS, VECTOR_SIZE
from observer_fi.physics.logger_table import acquisition_from, acquisition_table, without_nothing
from observer_fi.physics.sheets.derived import GUESS, GUESSED, UNLEARNED, derived
from observer_fi.records import Acquisition, Array, Log
from observer_fi.settings import toml_table

_SWITCHES = ("coupling", "contact", "rubbing", "x_stop_high", "x_stop_low")
_FORMS = (
    "stribeck_speed",
    "saturation_speed",
    "warmup_time",
    "shaft_order",
    "gear_order",
    "rotor_share",
    "accel_ahead",
    "zone_step",
    "screw_lead",
    "heating_time",
    "sag_time",
    "position_period",
    "Kx",
    "x_window",
)
_SHAPES = (*_SWITCHES, *_FORMS)  # change nothing on their own

# Of every effect: its parameter, where that stands, and the value that leaves the equations as they are.
_NEUTRAL = tuple(
    (name, at, PARAMETERS[name][1])
    for at, name in enumerate(NAMES)
    if PARAMETERS[name][1] is not None and name not in _SHAPES and not is_curve(name)
)


NOTICED = 1.15  # times the noise of the rig file: less is the rig file's
LEAST_CHANGE = 1e-3  # of that noise: what readings change by at least


@dataclass(frozen=True)
class Model:
    """name; values of every parameter of the equations (SI, pitch in degrees), in the order of `PARAMETERS`."""

    name: str
    values: tuple[float, ...]

    def __getitem__(self, parameter: str) -> float:
        return self.values[_position(parameter)]

    def __contains__(self, parameter: object) -> bool:
        return parameter in INDEX

    @property
    def vector(self) -> Array:
        """(VECTOR_SIZE,) what the equations take; the last slot says whether any effect is away from neutral, or a curve kept."""
        p = np.empty(VECTOR_SIZE)
        p[:EXTENDED] = self.values
        p[EXTENDED] = float(bool(self.effects) or self["curve_of"] != 0.0)
        return p

    @property
    def effects(self) -> tuple[str, ...]:
        """Parameters of effects that are away from their neutral value."""
        return tuple(name for name, at, neutral in _NEUTRAL if self.values[at] != neutral)


def unknown_name(given: str, known: tuple[str, ...], what: str) -> UsageError:
    """The error for a misspelt name: what was given, the nearest right one, and all that exist."""
    near = difflib.get_close_matches(given, known, n=1)
    hint = f", did you mean {near[0]!r}?" if near else ""
    return UsageError(f"there is no {what} {given!r}{hint} (known: {', '.join(known)})")


def _position(parameter: str) -> int:
    if parameter not in INDEX:
        raise unknown_name(parameter, tuple(n for n in NAMES if not is_curve(n)), "parameter")
    return INDEX[parameter]


def override(model: Model, name: str, **parameters: float) -> Model:
    """`model` under a new name with some parameters changed. Raises UsageError for a parameter that does not exist."""
    values = list(model.values)
    for parameter, value in parameters.items():
        values[_position(parameter)] = float(value)
    return Model(name, tuple(values))


@dataclass(frozen=True)
class Quantity:
    """One value of a rig: unit, how it was found, its 1-sigma spread from rig to rig, and its standard error if fitted."""

    value: float
    unit: str
    method: str = ""
    source: str = ""
    spread: float = 0.0
    std: float | None = None


@dataclass(frozen=True)
class Rig:
    """A plant, how it is driven, and the noise of its channels.

    drive: one of `DRIVES`. noise: standard deviation of each channel, V, A, m. quantities: what the file gives, by
    name of parameter; everything else is neutral. logger: what a log has shown of the logger. errors: how far healthy logs have
    shown the equations to be off, by `ERRORS` of `rig_file.py`; empty where none was learned from. inductance: of the winding
    [H], which the equations leave out and readings are taken without; None where nobody knows of one.
    """

    name: str
    description: str
    drive: str
    quantities: dict[str, Quantity]
    noise: dict[str, float] = field(
        default_factory=lambda: {"voltage": 0.01, "current": 3e-4, "position": 1e-5}
    )
    source: str = ""
    logger: Acquisition | None = None
    errors: dict[str, float] = field(default_factory=dict)
    inductance: Quantity | None = None

    @property
    def model(self) -> Model:
        """The nominal model of this rig."""
        values = []
        for name, (_, neutral) in PARAMETERS.items():
            if name in self.quantities:
                values.append(self.quantities[name].value)
            else:
                values.append(0.0 if neutral is None else neutral)
        return Model("nominal", tuple(values))

    @property
    def curve(self) -> Curve | None:
        """The empirical curve that was kept, if any."""
        values = {name: q.value for name, q in self.quantities.items()}
        return curve_of(values, {name: q.std for name, q in self.quantities.items() if q.std is not None})

    @property
    def driven(self) -> Drive:
        """The row of its drive."""
        return DRIVES[self.drive]

    @property
    def watched(self) -> Drive:
        """The row by which filters take it: that of a drive whose servo nobody knows, where a constant of the servo is none that
        a log has shown. A servo at its limit with a supply from a data sheet explains no stall.
        """
        guessed = any(n in self.quantities and self.quantities[n].method in UNLEARNED for n in SERVOS_OWN)
        return DRIVES["voltage"] if self.driven.servo and guessed else self.driven

    @property
    def without_servo(self) -> "Rig":
        """This rig with guesses for the constants of its servo, and without what its equation was found to be off."""
        guesses = {n: replace(q, method=GUESS) for n, q in self.quantities.items() if n in SERVOS_OWN}
        errors = {name: size for name, size in self.errors.items() if name != "servo"}
        return replace(self, quantities={**self.quantities, **guesses}, errors=errors)

    @property
    def law(self) -> CommandLaw | None:
        """The law that makes the commanded speed of other columns. Where nobody knows the servo, a command so low that friction
        may hold the motor against it is none; where logs have told the mechanics and no gain of a loop, as of one that is fed
        forward, nothing makes it and it must be recovered.
        """
        law, model = self.driven.command, self.model
        if law is None or self.watched.servo:
            return law
        if self.quantities["Kx"].method in UNLEARNED and self.quantities["J"].method not in UNLEARNED:
            return None
        return CommandLaw(law.columns, partial(_faster, law.of, CRAWLS * model["Vmax"] / model["Km"]))

    def spread(self, name: str) -> float:
        """1-sigma spread of a parameter from rig to rig, relative; 0 where the file gives none."""
        return self.quantities[name].spread if name in self.quantities else 0.0

    @property
    def noise_std(self) -> Array:
        """(3,) standard deviation of voltage [V], current [A], position [m] that filters assume.

        That of the file, where the logger does not need clearly more; rounding comes on top of it.
        """
        usual = self.file_noise_std
        if self.logger is None:
            return usual
        seen = np.array([channel.as_white for channel in self.logger[:3]])
        return np.where(seen > np.where(self.step > 0.0, 1.0, NOTICED) * usual, seen, usual)

    @property
    def file_noise_std(self) -> Array:
        """(3,) what the rig file says of the noise, V, A, m."""
        return np.array([self.noise["voltage"], self.noise["current"], self.noise["position"]])

    @property
    def neighbour_std(self) -> Array:
        """(3,) standard deviation of what noise alone changes from reading to reading, V, A, m, at most that of the file."""
        usual = self.file_noise_std
        seen = np.array([c.neighbour_std for c in self.logger[:3]]) if self.logger else usual
        return np.clip(np.where(np.isfinite(seen), seen, usual), LEAST_CHANGE * usual, usual)

    @property
    def repeats(self) -> Array:
        """(3,) share of readings at rest that repeat the one before."""
        return np.array([channel.repeats for channel in self.logger[:3]] if self.logger else [0.0] * 3)

    @property
    def step(self) -> Array:
        """(3,) step of the readings, V, A, m; 0 where they have none."""
        return np.array(
            [channel.resolution or 0.0 for channel in self.logger[:3]] if self.logger else [0.0] * 3
        )


CRAWLS = (
    0.03  # of the speed without a load: slower, and a position loop only waits for the friction to give way
)


def _faster(of: Callable[..., Array], least: float, *columns: Array) -> Array:
    """A command by the law `of`, 0 where it is slower than `least` [rad/s]."""
    w_cmd = of(*columns)
    return np.where(np.abs(w_cmd) < least, 0.0, w_cmd)


def commanded(log: Log, rig: Rig) -> Log:
    """`log` with the commanded speed that its drive makes of other columns; as it is where the log has it or must recover it.

    Raises InvalidLogError naming the column that the drive's law needs and the log has not.
    """
    law = rig.law
    if law is None:
        return log
    given = {"position_cmd_m": log.position_cmd, "encoder_rad": log.encoder}
    for column in law.columns:
        if given[column] is None:
            raise InvalidLogError(
                f"{log.path}: column {column} is missing, which the loop of a position servo needs; log it, "
                'or give a rig with drive = "voltage"'
            )
    w_cmd = law.of(*(given[column] for column in law.columns), rig.model.vector)
    return replace(log, w_cmd=filled(w_cmd, log.t))


def whole_command(log: Log, rig: Rig) -> Array:
    """(n,) the commanded speed of a log as its servo takes it, crawl and all [rad/s]."""
    law = rig.driven.command
    if law is None or log.position_cmd is None or log.encoder is None:
        return log.w_cmd
    return filled(law.of(log.position_cmd, log.encoder, rig.model.vector), log.t)


def with_values(
    rig: Rig, values: dict[str, float], std: dict[str, float] | None = None, method: str = "fit"
) -> Rig:
    """`rig` with some quantities replaced or added, marked with how they were found. Raises UsageError as `override`."""
    quantities = dict(rig.quantities)
    for name, value in values.items():
        _position(name)
        old = quantities.get(name, Quantity(value, PARAMETERS[name][0]))
        error = (std or {}).get(name)
        quantities[name] = replace(old, value=float(value), method=method, std=error)
    return replace(rig, quantities=quantities)


def load_rig(path: str | Path | None = None) -> Rig:
    """The rig of a TOML file, of a packaged name such as "emps", or the paper's mass-shifter.

    Raises UsageError naming the file, the key and the right keys.
    """
    where = _rig_path("mass_shifter" if path is None else path)
    try:
        table = toml_table(where, "rig file", "data/rigs")
    except UsageError as error:
        if isinstance(error.__cause__, FileNotFoundError):
            raise _no_such_rig(where) from error
        raise
    return _rig_from_table(table, str(where))


def _no_such_rig(given: Path) -> UsageError:
    """The error for a rig that is neither a file nor packaged: the nearest packaged one, and all of them."""
    names = sorted(path.stem for path in packaged_rigs().glob("*.toml"))
    near = difflib.get_close_matches(given.stem, names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "; give a TOML file, or the name of a packaged rig"
    return UsageError(
        f"{given}: cannot read the rig file (no such file){hint} (packaged: {', '.join(names)})"
    )


def packaged_rigs() -> Path:
    """Folder of the rigs that come with the package: inside it when installed, data/rigs in a checkout."""
    inside = Path(str(resources.files("observer_fi"))) / "rigs"
    return inside if inside.is_dir() else Path(__file__).resolve().parents[2] / "data" / "rigs"


def _rig_path(path: str | Path) -> Path:
    given = Path(path)
    packaged = packaged_rigs() / f"{given.name}.toml"
    return packaged if not given.suffix and not given.exists() and packaged.exists() else given


_TOP = (
    "name",
    "description",
    "drive",
    "source",
    "noise",
    "parameters",
    "curve",
    "acquisition",
    "errors",
    "inductance",
)
_QUANTITY = ("value", "unit", "method", "source", "spread", "std")
_NOISE = ("voltage", "current", "position")


def _rig_from_table(table: dict, where: str) -> Rig:
    try:
        rig_file.check(table)
        _check_keys(table, _TOP, "key")
        drive = table.get("drive", "pi_servo")
        if drive not in DRIVES:
            raise unknown_name(drive, tuple(DRIVES), "drive")
        _check_keys(table.get("noise", {}), _NOISE, "noise channel")
        _check_keys(table.get("errors", {}), rig_file.ERRORS, "error of an equation")
        quantities = {name: _quantity(name, entry) for name, entry in table.get("parameters", {}).items()}
        if "curve" in table:
            if not DRIVES[drive].motor:
                raise UsageError(f"a curve needs moves that are simulated: not for drive {drive!r}")
            quantities |= _curve_quantities(curves.from_table(table["curve"]))
        missing = [n for n in DRIVES[drive].requires if n not in quantities]
        if missing:
            raise UsageError(f"parameters missing for drive {drive!r}: {', '.join(missing)}")
        useless = [n for n in DRIVES[drive].excludes if n in quantities]
        if useless:
            raise UsageError(f"parameters that drive {drive!r} has not: {', '.join(useless)}")
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
    if DRIVES[drive].motor:
        quantities |= _derived(quantities)
    noise = {"voltage": 0.01, "current": 3e-4, "position": 1e-5} | {
        k: float(v) for k, v in table.get("noise", {}).items()
    }
    return Rig(
        table.get("name", Path(where).stem),
        table.get("description", ""),
        drive,
        quantities,
        noise,
        table.get("source", ""),
        acquisition_from(table.get("acquisition", {})),
        {name: float(value) for name, value in table.get("errors", {}).items()},
        _inductance(table["inductance"]) if "inductance" in table else None,
    )


def _check_keys(table: dict, known: tuple[str, ...], what: str) -> None:
    for key in table:
        if key not in known:
            raise unknown_name(key, known, what)


def _quantity(name: str, given: object) -> Quantity:
    _position(name)
    if is_curve(name):
        raise UsageError(f"{name}: a curve stands in the table [curve]")
    return _value_of(name, PARAMETERS[name][0], given if isinstance(given, dict) else {"value": given})


def _inductance(entry: dict) -> Quantity:
    """Of the winding: no parameter of the equations."""
    return _value_of("inductance", "H", entry)


def _value_of(name: str, own: str, entry: dict) -> Quantity:
    """A quantity in its own unit."""
    _check_keys(entry, _QUANTITY, f"key of {name}")
    unit = entry.get("unit", own)
    if unit != own:
        raise UsageError(f"{name}: unit must be {own!r}, got {unit!r}")
    std = entry.get("std")
    return Quantity(
        float(entry["value"]),
        unit,
        entry.get("method", ""),
        entry.get("source", ""),
        float(entry.get("spread", 0.0)),
        None if std is None else float(std),
    )


def rederived(rig: Rig) -> Rig:
    """`rig` with what was guessed from other values guessed anew from those it has now."""
    if not rig.driven.motor:
        return rig
    guessed = [name for name in GUESSED if name in rig.quantities and rig.quantities[name].method == GUESS]
    known = {name: q for name, q in rig.quantities.items() if name not in guessed}
    return replace(rig, quantities=known | _derived(known))


def _derived(quantities: dict[str, Quantity]) -> dict[str, Quantity]:
    """What faults need of a rig whose file leaves it out: a zero would be a rig without stop, gravity and bearings."""
    found = derived({name: q.value for name, q in quantities.items()})
    return {
        name: Quantity(one.value, PARAMETERS[name][0], one.method, one.source, one.spread)
        for name, one in found.items()
    }


def with_curve(rig: Rig, curve: Curve) -> Rig:
    """`rig` with an empirical curve, in place of any other."""
    kept = {name: q for name, q in rig.quantities.items() if not is_curve(name)}
    return replace(rig, quantities=kept | _curve_quantities(curve))


def _curve_quantities(curve: Curve) -> dict[str, Quantity]:
    std = dict(zip(curve.names, curve.std, strict=False))
    return {
        name: Quantity(value, PARAMETERS[name][0], std=std.get(name))
        for name, value in curves.parameters(curve).items()
    }


def rig_toml(rig: Rig) -> str:
    """The rig as the text of a TOML file that `load_rig` reads back to an equal rig."""
    parameters = {}
    for name, q in rig.quantities.items():
        if is_curve(name):
            continue
        parameters[name] = _entry(q)
    table: dict[str, object] = {"name": rig.name, "description": rig.description, "drive": rig.drive}
    table |= {"source": rig.source} if rig.source else {}
    table |= {"noise": dict(rig.noise), "parameters": parameters}
    logger = without_nothing(acquisition_table(rig.logger))
    table |= {"acquisition": logger} if logger else {}
    table |= {"errors": dict(rig.errors)} if rig.errors else {}
    table |= {"inductance": _entry(rig.inductance)} if rig.inductance else {}
    curve = rig.curve
    return tomli_w.dumps(table | ({"curve": curves.to_table(curve)} if curve else {}))


def _entry(q: Quantity) -> dict[str, object]:
    """A quantity as a rig file has it."""
    told = (("method", q.method), ("source", q.source), ("spread", q.spread), ("std", q.std))
    return {"value": q.value, "unit": q.unit, **{k: v for k, v in told if v}}
