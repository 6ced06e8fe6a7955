"""Fits and causes of a force-driven rig as Markdown tables: numbers that the package computed."""

import math
from collections.abc import Iterable, Mapping, Sequence

from observer_fi.improve import Improvement, Value
from observer_fi.learn import Sharing, Solution
from observer_fi.physics import PARAMETERS, Rig
from observer_fi.records import Fit
from observer_fi.report import at_mass


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table; floats as they are given, so format them before."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


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
        at = at_mass(Value(p.value, p.std, p.prior, p.unit), rig.model["D"])
        felt = f"{rounded(at.value, at.std)} {at.unit}"
        rows.append((f"`{p.name}`", f"{p.value:.5g} {p.unit}", felt, f"{at.prior:.5g} {at.unit}"))
    return table(("parameter", "value", "at the mass", "rig file"), rows)


def findings_table(record: Improvement, held_out: Sequence[float], judged: Sequence[float]) -> str:
    """The causes in order.

    held_out: residual on held-out parts before the first step and after each; judged: after each step on a part that nothing
    was learned from [per cent].
    """
    D, rows = record.rig.model["D"], []
    shared = [f.step for f in record.findings]
    for f in record.findings:
        step = f"{f.step} (pair)" if shared.count(f.step) > 1 else f"{f.step}"
        sizes = "; ".join(_size(name, at_mass(v, D)) for name, v in f.parameters.items())
        change = f"{held_out[f.step - 1]:.2f} → {held_out[f.step]:.2f}"
        rivals = ", ".join(f.indistinguishable_from) or "-"
        rows.append(
            (step, f"`{f.cause}`", f.variant, sizes, f"{f.delta_bic:.0f}", change,
             f"{judged[f.step - 1]:.2f}", rivals)
        )  # fmt: skip
    head = ("step", "cause", "form", "size", "ΔBIC", "held out [%]", "judged [%]", "cannot be told from")
    return table(head, rows)


def _size(name: str, at: Value) -> str:
    value, std, prior, unit = at.value, at.std, at.prior, at.unit
    if unit in ("s", "m", "m/s"):
        value, std, prior, unit = 1e3 * value, 1e3 * std, 1e3 * prior, "m" + unit
    before = f" (rig file {prior:.3g})" if prior and name == "input_delay" else ""
    return f"{name} {rounded(value, std)} {unit}{before}".removesuffix(" 1")


def separation_list(record: Improvement) -> str:
    """What to record to tell each cause from its rivals."""
    return "".join(dict.fromkeys(f"- `{f.cause}`: {f.separate_by}\n" for f in record.findings))


def refused_table(record: Improvement) -> str:
    """Causes that were not found, with the smallest size that these logs would have shown."""
    D, net = record.rig.model["D"], dict(record.refused)
    found = {f.cause for f in record.findings}
    rows = []
    for cause, sizes in record.detectable.items():
        if cause in found or not sizes:
            continue
        shown = [(n, at_mass(Value(s, 0.0, 0.0, PARAMETERS[n][0]), D)) for n, s in sizes.items()]
        won = f"{2.0 * net[cause]:.0f}" if cause in net else "-"
        rows.append((f"`{cause}`", won, "; ".join(f"{n} {at.value:.2g} {at.unit}" for n, at in shown)))
    return table(("cause", "ΔBIC", "smallest size these logs would show"), rows)


def refit_table(record: Improvement) -> str:
    """Parameters that only moved: those of the rig file that no finding speaks of."""
    rows = []
    for name, value in record.refit.items():
        at = at_mass(value, record.rig.model["D"])
        rows.append((f"`{name}`", f"{rounded(at.value, at.std)} {at.unit}", f"{at.prior:.5g} {at.unit}"))
    return table(("refitted", "value", "rig file"), rows)


def unexplained_table(record: Improvement) -> str:
    """What the rest of the residual depends on."""
    rows = [(term.regressor, f"{100 * term.share:.0f} %") for term in record.unexplained]
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
