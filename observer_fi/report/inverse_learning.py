"""Fits and ladders of force-driven rigs as Markdown and as the files of `improve`: numbers that other modules computed."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from observer_fi.improve import Candidate, Ladder, Score, extended, findings, inverse_json, inverse_refit
from observer_fi.learn import Sharing, Solution, held_out, relative
from observer_fi.physics import PARAMETERS, Rig, rig_toml
from observer_fi.records import Fit, Parameter
from observer_fi.report.diagnosis import environment, json_text, versions
from observer_fi.report.inverse_figures import of_ladder

# unit in the equations: unit at the mass, power of D by which a value is divided
AT_MASS = {
    "kg m^2": ("kg", 2),
    "N m": ("N", 1),
    "N m s/rad": ("N s/m", 2),
    "N m/m": ("N/m", 1),
    "N m/m^2": ("N/m^2", 1),
    "N m/deg": ("N/deg", 1),
    "rad/s": ("m/s", -1),
}


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; floats as they are given, so format them before."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def at_mass(parameter: Parameter, D: float) -> tuple[float, float, float, str]:
    """Value, standard error and earlier value of a parameter as force at the mass, and the unit."""
    unit, power = AT_MASS.get(parameter.unit, (parameter.unit, 0))
    scale = D**-power
    return parameter.value * scale, parameter.std * scale, parameter.prior * scale, unit


def rounded(value: float, std: float) -> str:
    """value +- std with two digits of the standard error."""
    if not math.isfinite(std) or std <= 0.0:
        return f"{value:.4g}"
    digits = max(1 - math.floor(math.log10(std)), 0)
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def fit_table(fit: Fit, rig: Rig) -> str:
    """Parameters of a fit against those of the rig file, in the units of the equations and at the mass."""
    rows = []
    for p in fit.parameters:
        value, std, prior, unit = at_mass(p, rig.model["D"])
        rows.append(
            (f"`{p.name}`", f"{p.value:.5g} {p.unit}", f"{rounded(value, std)} {unit}", f"{prior:.5g} {unit}")
        )
    return table(("parameter", "value", "at the mass", "rig file"), rows)


class Line(NamedTuple):
    """One accepted cause as it is printed. before, after: held-out residual of its step [per cent]."""

    step: str
    cause: str
    form: str
    sizes: list[str]
    delta_bic: float
    before: float
    after: float
    rivals: tuple[str, ...]
    separate_by: str


def lines(ladder: Ladder) -> list[Line]:
    """The causes in the order in which they were accepted; a pair shares its step."""
    found: list[Line] = []
    named = iter(findings(ladder))
    for k, rung in enumerate(ladder.rungs, start=1):
        step = f"{k}" if len(rung.candidates) == 1 else f"{k} (pair)"
        for candidate in rung.candidates:
            f = next(named)
            form, sizes = (
                _form(candidate, f.parameters),
                [_size(p, ladder.rig.model["D"]) for p in f.parameters],
            )
            rivals = f.indistinguishable_from
            found.append(
                Line(step, f.cause, form, sizes, f.delta_bic, rung.before, rung.after, rivals, f.separate_by)
            )
    return found


def findings_table(ladder: Ladder, judged: Sequence[float]) -> str:
    """The causes in order; judged: residual after each step on a part that nothing was learned from [per cent]."""
    by_step = {f"{k}": f"{value:.2f}" for k, value in enumerate(judged, start=1)}
    rows = [
        (f.step, f"`{f.cause}`", f.form, "; ".join(f.sizes), f"{f.delta_bic:.0f}", f"{f.before:.2f} → {f.after:.2f}",
         by_step[f.step.split()[0]], ", ".join(f.rivals) or "-")
        for f in lines(ladder)
    ]  # fmt: skip
    head = ("step", "cause", "form", "size", "ΔBIC", "held out [%]", "judged [%]", "cannot be told from")
    return table(head, rows)


def _form(candidate: Candidate, parameters: Iterable[Parameter]) -> str:
    """The form in words; a local friction that falls towards standstill is not what Stribeck described, so say so."""
    falls = any(p.name == "stribeck_torque" and p.value < 0.0 for p in parameters)
    return candidate.variant + (": friction falls towards standstill" if falls else "")


def _size(parameter: Parameter, D: float) -> str:
    value, std, prior, unit = at_mass(parameter, D)
    if unit in ("s", "m", "m/s"):
        value, std, prior, unit = 1e3 * value, 1e3 * std, 1e3 * prior, "m" + unit
    before = f" (rig file {prior:.3g})" if prior and parameter.name == "input_delay" else ""
    return f"{parameter.name} {rounded(value, std)} {unit}{before}".removesuffix(" 1")


def separation_list(ladder: Ladder) -> str:
    """What to record to tell each cause from its rivals."""
    return "".join(f"- `{f.cause}`: {f.separate_by}\n" for f in findings(ladder))


def detectable(ladder: Ladder) -> dict[str, list[str]]:
    """By cause that was not found: the smallest size of each parameter that these logs would show."""
    found: dict[str, list[str]] = {}
    for score in ladder.refused:
        if score.candidate.cause not in found:
            sizes = score.detectable.items()
            found[score.candidate.cause] = [
                _smallest(name, size, ladder.rig.model["D"]) for name, size in sizes
            ]
    return found


def _smallest(name: str, size: float, D: float) -> str:
    if not math.isfinite(size):
        return f"{name}: not detectable here"
    unit, power = AT_MASS.get(PARAMETERS[name][0], (PARAMETERS[name][0], 0))
    return f"{name} {size * D**-power:.2g} {unit}"


def refused_table(ladder: Ladder) -> str:
    """Causes that were not found, with their best score and the smallest size that these logs would have shown."""
    best: dict[str, Score] = {}
    for score in ladder.refused:
        best.setdefault(score.candidate.cause, score)
    rows = [
        (f"`{cause}`", best[cause].candidate.variant, _whole(best[cause].net), "; ".join(sizes))
        for cause, sizes in detectable(ladder).items()
    ]
    return table(("cause", "form", "ΔBIC", "smallest size these logs would show"), rows)


def _whole(value: float) -> str:
    return f"{value:.0f}" if math.isfinite(value) else "-"


def refit_table(ladder: Ladder) -> str:
    """Parameters that only moved: those of the rig file that no finding speaks of."""
    D = ladder.rig.model["D"]
    rows = []
    for p in inverse_refit(ladder):
        value, std, prior, unit = at_mass(p, D)
        rows.append((f"`{p.name}`", f"{rounded(value, std)} {unit}", f"{prior:.5g} {unit}"))
    return table(("refitted", "value", "rig file"), rows)


def unexplained_table(ladder: Ladder) -> str:
    """What the rest of the residual depends on."""
    rows = [(name, f"{100 * share:.0f} %") for name, share in ladder.unexplained]
    return table(("regressor", "share of the residual's variance"), rows)


def per_log_table(solution: Solution, D: float) -> str:
    """Coefficients that belong to one log: ripple amplitude and phase, departure of the friction level."""
    rows = []
    values = {
        (c.term.name, c.log): float(th) / D
        for c, th in zip(solution.coefficients, solution.theta, strict=True)
    }
    for (name, log), value in values.items():
        if name.endswith("_sin"):
            other = values[(name.replace("_sin", "_cos"), log)]
            size = f"{math.hypot(value, other):.2f} N at {math.degrees(math.atan2(other, value)):.0f} deg"
            rows.append((name.removesuffix("_sin"), log, size))
    for c, th in zip(solution.coefficients, solution.theta, strict=True):
        if c.term.sharing is Sharing.CONTRAST:
            rows.append(("friction level, from the mean of the logs", c.log, f"{float(th) / D:+.2f} N"))
    return table(("what", "log", "value"), rows) if rows else ""


def scores_table(head: Sequence[str], scores: Mapping[str, Sequence[float]]) -> str:
    """Models against columns of numbers."""
    return table(("model", *head), [(name, *(f"{v:.2f}" for v in row)) for name, row in scores.items()])


def inverse_headline(ladder: Ladder) -> str:
    """One line: what the equations miss."""
    named = [f.cause.replace("_", " ") for f in findings(ladder)]
    if not named:
        return "Nothing with a name is missing" + (", but something is" if ladder.unexplained else "")
    rest = " and something without a name" if ladder.unexplained else ""
    return f"The equations miss {', '.join(named)}{rest}"


def inverse_files(ladder: Ladder, name: str, logs: Sequence[str]) -> dict[str, str]:
    """Everything that one improve report of a force-driven rig consists of, {file name: text}."""
    page = environment().get_template("improve_force.html")
    before, after = (relative(held_out(s), s.force) for s in (ladder.start, ladder.final))
    drawn = of_ladder(ladder)
    html = page.render(
        ladder=ladder, figures=drawn, name=name, logs=logs, headline=inverse_headline(ladder), findings=lines(ladder),
        refit=inverse_refit(ladder), detectable=detectable(ladder), before=before, after=after, versions=versions(),
    )  # fmt: skip
    return {
        "improve.json": json_text(inverse_json(ladder)),
        "improve.html": html,
        "extended_rig.toml": rig_toml(extended(ladder, f"{ladder.rig.name}_extended")),
        **{f"{key}.svg": svg for key, svg in drawn.items()},
    }
