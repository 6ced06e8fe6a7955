"""Truth against `improve`: one row a case, and the table of `reports/improve.md`."""

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import hidden
import numpy as np

from observer_fi.improve import Improvement, improve
from observer_fi.learn import nll_per_sample, prepare, whitened
from observer_fi.logs import log_from_frame
from observer_fi.physics import CAUSES, load_rig
from observer_fi.records import Array, Log

PAIRS = (
    ("viscous_friction", "backlash"),
    ("screw_ripple", "load_dependent_friction"),
    ("winding_heating", "position_lag"),
    ("current_lag", "torque_offset"),
    ("brush_drop", "stribeck_friction"),
    ("supply_sag", "position_dependent_friction"),
    ("shaft_ripple", "current_offset"),
    ("input_delay", "voltage_offset"),
)
READINGS = ["voltage_v", "current_a", "position_m"]
RIGS = ("rig_file", "refit", "extended")  # asked about measured moves that no fit saw
HANDED = "the one handed over"


@dataclass(frozen=True)
class Case:
    """What is hidden: causes, size in units of the detectable one, seed, and whether the vocabulary has them.

    rate_hz: of the logger, 0 for the one that the truth has.
    """

    causes: tuple[str, ...]
    size: float
    seed: int
    inside: bool
    rate_hz: float = 0.0


def case_of(row: dict[str, Any]) -> Case:
    """The case that a row is about."""
    return Case(tuple(row["causes"]), row["size"], row["seed"], row["inside"], row.get("rate_hz", 0.0))


def run_case(case: Case) -> dict[str, Any]:
    """One row: what was found, in order, whether it is right, and how far the size is off in standard errors."""
    spec = hidden.draw_effects_case(case.seed, case.causes, case.size)
    spec = replace(spec, logger=replace(spec.logger, rate_hz=case.rate_hz or spec.logger.rate_hz))
    frame, truth = hidden.make_log(spec, case.seed)
    log = log_from_frame(frame)
    began = time.process_time()
    record = improve([log], load_rig())
    seconds = time.process_time() - began
    sets = [[f.cause, *f.indistinguishable_from] for f in record.findings]
    smooth = [[u.equation, u.regressor] for u in record.unexplained]
    clean = hidden.make_log(hidden.without_noise(spec), case.seed)[0][READINGS].to_numpy()
    row: dict[str, Any] = {
        "causes": list(case.causes),
        "size": case.size,
        "seed": case.seed,
        "inside": case.inside,
        "rate_hz": case.rate_hz,
        "found": sets,
        "unexplained": smooth,
        "seconds": seconds,
        "errors": _errors(record, spec.effects),
        "gain_share": _gain_share(record, log, clean),
        "new_moves": {name: list(getattr(record.new_moves, name)) for name in RIGS},
        "written": record.new_moves.best,
    }
    if not case.inside:
        effect = truth["effects"][0]
        told = [f"sensor:{f.channel}" for f in record.filters]
        row["filters"] = told
        row["equation"] = not sets and any(
            e in effect["equations"] for e in [e for e, _ in smooth[:1]] or told
        )
        row["right"] = not sets and (
            any(e in effect["equations"] and r in effect["regressors"] for e, r in smooth[:1])
            or (not smooth and any(e in effect["equations"] for e in told))
        )
    return row


def _gain_share(record: Improvement, noisy: Log, clean: Array) -> float | None:
    """Gain on held-out moves over that of the truth itself, which leaves nothing but this log's noise.

    clean: (n, 3) the same readings without noise, as the truth made them: a log of them would be taken for one of held readings.
    """
    if not record.findings:
        return None
    experiment = prepare([noisy], record.rig)
    rows = np.searchsorted(noisy.t, experiment.t)
    noise = np.where(experiment.weight > 0.0, (noisy.z - clean)[rows], 0.0) * experiment.weight
    possible = record.baseline.nll_per_sample - nll_per_sample(experiment, whitened(experiment, noise))
    won = record.baseline.nll_per_sample - record.extended.nll_per_sample
    return won / possible if possible > 0.0 else None


def _errors(record: Improvement, effects: Iterable[hidden.Effect]) -> dict[str, float]:
    """(estimate - truth) in standard errors, for every found cause with a size to compare."""
    found = {f.cause: f.parameters for f in record.findings}
    errors = {}
    for effect in effects:
        size = hidden.right_size(effect)
        if size is None or not all(name in found.get(effect.cause, {}) for name in size.parameters):
            continue
        values = [found[effect.cause][name] for name in size.parameters]
        estimate = values[0].value if len(values) == 1 else math.hypot(*(v.value for v in values))
        std = max(v.std for v in values)
        if std > 0.0 and math.isfinite(estimate):
            errors[effect.cause] = (estimate - size.value) / std
    return errors


def _first(row: dict[str, Any]) -> bool:
    """The hidden cause is the first finding, or in its declared set."""
    return bool(row["found"]) and row["causes"][0] in row["found"][0]


def _named_first(row: dict[str, Any]) -> bool:
    return bool(row["found"]) and row["causes"][0] == row["found"][0][0]


def _all_found(row: dict[str, Any]) -> bool:
    return all(any(cause in names for names in row["found"]) for cause in row["causes"])


def _extra(row: dict[str, Any]) -> bool:
    return any(not set(names) & set(row["causes"]) for names in row["found"]) or bool(row["unexplained"])


def _silent(row: dict[str, Any]) -> bool:
    return not row["found"] and not row["unexplained"]


def _right(row: dict[str, Any]) -> bool:
    return bool(row["right"])


def summary(rows: list[dict[str, Any]]) -> str:
    """The text of `reports/improve.md`."""
    seeds = sorted({r["seed"] for r in rows}) or [0]
    lines = [
        "# What `improve` finds",
        "",
        f"Made by `pipelines/improve_study.py` from an independent truth, seeds {seeds[0]} to {seeds[-1]}, none seen before.",
        "Sizes are in units of the detectable one (50 standard deviations of the noise over a whole log).",
        "",
        *_by_size(rows),
        "",
        *_figures(rows),
        "",
        "## By cause",
        "",
        *_by_cause(rows),
        "",
        "## Misses",
        "",
        *_misses(rows),
    ]
    return "\n".join(lines) + "\n"


def _single(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [r for r in rows if r["inside"] and len(r["causes"]) == 1]


def _by_size(rows: list[dict[str, Any]]) -> list[str]:
    lines = ["| hidden | cases | first, or in the first's declared set | first by name | found at all | set size |"
             " with another finding, or anything unexplained |", "|---|---|---|---|---|---|---|"]  # fmt: skip
    for size in sorted({r["size"] for r in _single(rows)}):
        these = [r for r in _single(rows) if r["size"] == size]
        sets = [len(r["found"][0]) for r in these if _first(r)]
        lines.append(
            f"| {size:g} x detectable | {len(these)} | {_share(these, _first)} | {_share(these, _named_first)} |"
            f" {_share(these, _all_found)} | {np.mean(sets) if sets else 0:.2f} | {_share(these, _extra)} |"
        )
    return lines


def _figures(rows: list[dict[str, Any]]) -> list[str]:
    controls = [r for r in rows if not r["causes"]]
    pairs = [r for r in rows if len(r["causes"]) == 2]
    errors = [{"error": abs(e)} for r in rows for e in r["errors"].values()]
    gains = [r for r in rows if r["gain_share"] is not None]
    seconds = _median([r["seconds"] for r in rows])
    entries = [
        ("controls without any finding, and nothing unexplained", controls, _silent),
        ("pairs at 3 x, both found", pairs, _all_found),
        *(
            (f"outside the vocabulary at {size:g} x: right equation and regressor, no name", these, _right)
            for size in sorted({r["size"] for r in rows if not r["inside"]})
            if (these := [r for r in rows if not r["inside"] and r["size"] == size])
        ),
        ("sizes within three standard errors", errors, lambda e: e["error"] < 3.0),
        ("held-out gain at least 95 % of the true model's", gains, lambda r: r["gain_share"] >= 0.95),
    ]
    lines = ["| | cases | share |", "|---|---|---|"]
    lines += [f"| {text} | {len(these)} | {_share(these, good)} |" for text, these, good in entries]
    lines += [
        f"| measured healthy moves that no fit saw, without false alarm: {name.replace('_', ' ')} | {_moves(rows, name)} |"
        for name in (*RIGS, HANDED)
    ]
    lines.append(f"| seconds of processor per log, median | {len(rows)} | {seconds} |")
    return lines


def _moves(rows: list[dict[str, Any]], rig: str) -> str:
    """Moves that a rig was asked about, and the share that it calls healthy. rig: of RIGS, or HANDED."""
    counts = [r["new_moves"][r["written"] if rig == HANDED else rig] for r in rows]
    moves, alarms = (sum(c[k] for c in counts) for k in (0, 1))
    return f"{moves} | {1.0 - alarms / moves:.0%}" if moves else "0 | -"


def _by_cause(rows: list[dict[str, Any]]) -> list[str]:
    single = _single(rows)
    sizes = sorted({r["size"] for r in single})
    lines = ["| cause | " + " | ".join(f"{s:g} x" for s in sizes) + " |", "|---|" + "---|" * len(sizes)]
    for cause in CAUSES:
        cells = [
            _share([r for r in single if r["causes"] == [cause] and r["size"] == s], _first) for s in sizes
        ]
        lines.append(f"| {cause} | " + " | ".join(cells) + " |")
    return lines


def _misses(rows: list[dict[str, Any]]) -> list[str]:
    """One line for every case that is not right in full."""
    lines = []
    for r in rows:
        good = (
            _right(r) if not r["inside"] else _all_found(r) and not _extra(r) if r["causes"] else _silent(r)
        )
        if not good:
            hidden = ", ".join(r["causes"]) or "nothing"
            found = "; ".join("/".join(names) for names in r["found"]) or "nothing"
            left = "; ".join(" by ".join(pair) for pair in r["unexplained"]) or "nothing"
            lines.append(
                f"- {hidden} at {r['size']:g} x, seed {r['seed']}: found {found}, unexplained {left}"
            )
    return lines or ["None."]


def _share(rows: list[dict[str, Any]], good: Callable[[dict[str, Any]], bool]) -> str:
    return f"{sum(good(r) for r in rows) / len(rows):.0%}" if rows else "-"


def _median(values: Iterable[float]) -> str:
    numbers = list(values)
    return f"{np.median(numbers):.3g}" if numbers else "-"
