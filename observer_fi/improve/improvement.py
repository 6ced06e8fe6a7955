"""Improve: what the simulation gets wrong, its name, the extended model, and what it gains on samples never fitted."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from observer_fi.errors import UsageError
from observer_fi.improve.behind_loop import told
from observer_fi.improve.force.calculated_force import calculated_force
from observer_fi.improve.freed.freed_equations import FreedEquation
from observer_fi.improve.freed.smoothed_disturbance import SmoothedDisturbance
from observer_fi.improve.ladder import name_causes
from observer_fi.improve.moves.judgement import MoveSettings
from observer_fi.improve.moves.keep_curve import Kept
from observer_fi.improve.moves.simulated_moves import simulated_moves
from observer_fi.improve.naming import named
from observer_fi.improve.new_moves import UNSEEN, NewMoves, handed_over, new_moves
from observer_fi.improve.problem import Problem
from observer_fi.improve.residual_tables import Residuals
from observer_fi.improve.steps import Candidate, F, Ladder, Measure, Smooth, Step
from observer_fi.learn import (
    Experiment,
    FitResult,
    campaign_readings,
    refuse_suspects,
    with_crawl,
    with_servo,
)
from observer_fi.logs import (
    Excitation,
    filtered_logger,
    on_its_clock,
    thinned,
    with_command,
    with_logger,
    without_winding,
)
from observer_fi.physics import CAUSES, PARAMETERS, Rig, to_table, with_curve
from observer_fi.records import Filter, Log, Segment

SCHEMA = "observer-fi/improve/1"


@dataclass(frozen=True)
class Value:
    """One parameter: value, standard error, what it was before, unit."""

    value: float
    std: float
    prior: float
    unit: str


@dataclass(frozen=True)
class FoundCause:
    """One finding of contract section 4, with the cause's formula and its variant in words.

    step: number of the step that it was accepted in; two causes that hide each other share one.
    """

    step: int
    cause: str
    equation: str
    variant: str
    formula: str
    parameters: dict[str, Value]
    delta_bic: float
    heldout_nll_drop_per_sample: float
    heldout_rmse_ratio: dict[str, float]
    indistinguishable_from: tuple[str, ...]
    separate_by: str


@dataclass(frozen=True)
class Improvement:
    """Everything that a report on `improve` needs.

    rig: as it was given, with the servo that its logs show. parts: what was held out in turn, in words. kept: the curve that
    stands for what is unexplained in the extended rig, if it was asked for (keep_unexplained) and helps. detectable: for each
    cause the smallest size that these logs could have shown, by parameter, or None where they cannot speak about the cause.
    refused: causes that were tried last, with their net nats. freed: for each equation of the refitted rig how much the data
    want it free, the most wanted first; disturbances: what that looks like; both empty where no move is simulated. excitations:
    what each log holds. new_moves: what `diagnose` makes of moves that no fit saw; extended_rig is the one that does best there.
    filters: that were taken out of the readings. warnings: what else was done to them.
    """

    rig: Rig
    extended_rig: Rig
    parts: str
    sample_count: int
    baseline: Measure
    extended: Measure
    refit: dict[str, Value]
    findings: tuple[FoundCause, ...]
    unexplained: tuple[Smooth, ...]
    keep_unexplained: bool
    kept: Kept | None
    detectable: dict[str, dict[str, float] | None]
    refused: tuple[tuple[str, float], ...]
    before: Residuals
    after: Residuals
    freed: tuple[FreedEquation, ...]
    disturbances: tuple[SmoothedDisturbance, ...]
    excitations: tuple[Excitation, ...]
    new_moves: NewMoves = UNSEEN
    filters: tuple[Filter, ...] = ()
    warnings: tuple[str, ...] = ()


def improve(
    logs: Sequence[Log],
    rig: Rig,
    moves: Sequence[Sequence[Segment]] | None = None,
    settings: MoveSettings | None = None,
    progress: Callable[[str], None] = lambda text: None,
    keep_unexplained: bool = False,
) -> Improvement:
    """The whole of `improve` for logs of one rig, however it is driven.

    moves, settings: of moves that are simulated. keep_unexplained: what no cause explains becomes an empirical curve of the
    extended rig, where it can. Raises UsageError for a rig whose drive these logs do not show, and
    InvalidLogError for a channel of another unit or sign.
    """
    logs = logs if moves else [thinned(log, rig) for log in logs]
    if not rig.driven.motor:
        if keep_unexplained:
            raise UsageError(
                'a curve (--keep-unexplained) needs a rig whose moves are simulated, not one with drive = "force"'
            )
        force = calculated_force(logs, rig)
        return improvement_of(force, name_causes(force, progress), progress)
    refuse_suspects(logs, rig)
    commanded = [with_command(log if moves else on_its_clock(log, rig), rig) for log in logs]
    commanded = [without_winding(with_crawl(log, rig), rig) for log in commanded]
    winding, rig = rig.inductance, replace(rig, inductance=None)
    campaign = campaign_readings(commanded, rig)
    taken, filters = campaign.logs, campaign.low_passes.told
    problem = simulated_moves(taken, campaign.known(with_servo(taken, rig)), moves, settings, filters)
    problem, ladder = named(problem, progress)
    found = improvement_of(problem, ladder, progress, keep_unexplained)
    progress("what diagnose says of moves that no fit saw")
    counts = new_moves(problem, ladder, rig)
    best = handed_over(problem, ladder, rig, found.extended_rig, counts.best)
    learned = filtered_logger(
        with_logger(best, [with_command(log, rig) for log in logs[:1]]), filters, logs[0].rate_hz
    )
    return replace(
        found, rig=problem.written, extended_rig=replace(learned, inductance=winding), new_moves=counts, filters=filters,
        warnings=(*campaign.told, *told(problem)),
    )  # fmt: skip


def improvement_of(
    problem: Problem[F],
    ladder: Ladder[F],
    progress: Callable[[str], None] = lambda text: None,
    keep_unexplained: bool = False,
) -> Improvement:
    """The record of what was named: the rest looked at, before and after measured."""
    progress("which equation the data want to free")
    freed, disturbances = problem.freed(ladder.baseline)
    progress("what stays unexplained")
    left = problem.unexplained(ladder)
    found = problem.kept(ladder.extended, left) if keep_unexplained else None
    kept = found[1] if found else None
    if found:
        ladder = replace(ladder, extended=found[0])
    baseline = problem.measure(ladder.baseline)
    extended_rig = problem.extended_rig(ladder)
    return Improvement(
        problem.rig,
        with_curve(extended_rig, kept.curve) if kept else extended_rig,
        problem.parts,
        problem.sample_count,
        baseline,
        problem.measure(ladder.extended) if ladder.steps or kept else baseline,
        refit_of(problem, ladder),
        findings_of(problem, ladder),
        left,
        keep_unexplained,
        kept,
        detectable(ladder.screened),
        ladder.refused,
        problem.tables(ladder.baseline),
        problem.tables(ladder.extended),
        freed,
        disturbances,
        problem.excitations(),
    )  # fmt: skip


def refitted(logs: Sequence[Log], rig: Rig) -> tuple[Experiment, FitResult]:
    """The moves of logs, and the refitted rig before any cause is tried."""
    problem = simulated_moves(logs, rig)
    return problem.experiment, problem.baseline()


def findings_of(problem: Problem[F], ladder: Ladder[F]) -> tuple[FoundCause, ...]:
    """The accepted causes in order, with their final sizes."""
    values = problem.values(ladder.extended)
    return tuple(
        _finding(problem, ladder.extended, values, number, step, candidate, net)
        for number, step in enumerate(ladder.steps, start=1)
        for candidate, net in zip(step.trial.candidates, step.trial.nets, strict=True)
    )


def _finding(
    problem: Problem[F],
    fitted: F,
    values: dict[str, tuple[float, float]],
    number: int,
    step: Step[F],
    candidate: Candidate,
    net: float,
) -> FoundCause:
    cause, variant = candidate.cause, candidate.variant
    parameters = {}
    for name in parameters_of_variant(candidate):
        value, std = values[name]
        before, unit = problem.rig.model[name], PARAMETERS[name][0]
        parameters[name] = Value(value, problem.doubt(fitted, name, std), before, unit)
    parameters |= {n: Value(v, 0.0, v, PARAMETERS[n][0]) for n, v in variant.fixed}
    rivals = step.rivals[cause.name]
    texts = [CAUSES[name].told_apart_by(problem.seen_by) for name in (cause.name, *rivals)]
    return FoundCause(
        number, cause.name, cause.equation, variant.name, cause.formula, parameters, 2.0 * net,
        step.held_out.drop, step.held_out.ratio, rivals, "; ".join(dict.fromkeys(t for t in texts if t)),
    )  # fmt: skip


def parameters_of_variant(candidate: Candidate) -> tuple[str, ...]:
    """Names of everything that a variant frees."""
    terms = candidate.variant.terms
    names = [name for t in terms for name in (t.parameter, *(other for other, _ in t.with_it))]
    return tuple(dict.fromkeys(names))


def refit_of(problem: Problem[F], ladder: Ladder[F]) -> dict[str, Value]:
    """Parameters that only moved: of everything that is free in the extended model, those that no finding speaks of."""
    named = {n for s in ladder.steps for c in s.trial.candidates for n in parameters_of_variant(c)}
    return {
        name: Value(value, std, problem.rig.model[name], PARAMETERS[name][0])
        for name, (value, std) in problem.values(ladder.extended).items()
        if name not in named
    }


def detectable(screened: Sequence[Candidate]) -> dict[str, dict[str, float] | None]:
    """Smallest size of each cause that would have stood out beside the last refit, by its best form; None: cannot be shown."""
    found: dict[str, dict[str, float] | None] = dict.fromkeys(CAUSES)
    for candidate in screened:
        name = candidate.cause.name
        seen = {k: v for k, v in candidate.detectable.items() if math.isfinite(v)}
        if found[name] is None and seen:
            found[name] = seen
    for name, cause in CAUSES.items():
        for alias in cause.aliases:
            if found[name] is None:
                found[name] = found[alias]
    return found


# --- JSON ------------------------------------------------------------------------------------------


def to_json(record: Improvement) -> dict[str, Any]:
    """Contract section 4."""
    return {
        "schema": SCHEMA,
        "baseline": asdict(record.baseline),
        "refit": {name: asdict(v) for name, v in record.refit.items()},
        "findings": [_finding_json(f) for f in record.findings],
        "unexplained": [
            {
                "equation": u.equation,
                "regressor": u.regressor,
                "share_of_residual_variance": u.share,
                "order": u.order,
                "frequency_hz": u.frequency_hz,
            }
            for u in record.unexplained
        ],
        "extended": asdict(record.extended),
        "new_moves": {
            **{name: getattr(record.new_moves, name)._asdict() for name in ("rig_file", "refit", "extended")},
            "written": record.new_moves.best,
        },
        "freed": [asdict(row) for row in record.freed],
    } | ({"kept": _kept_json(record, record.kept)} if record.kept else {})


def _finding_json(f: FoundCause) -> dict[str, Any]:
    return {
        "cause": f.cause,
        "equation": f.equation,
        "parameters": {n: {"value": v.value, "std": v.std, "unit": v.unit} for n, v in f.parameters.items()},
        "evidence": {"delta_bic": f.delta_bic},
        "gain": {
            "heldout_nll_drop_per_sample": f.heldout_nll_drop_per_sample,
            "heldout_rmse_ratio": f.heldout_rmse_ratio,
        },
        "indistinguishable_from": list(f.indistinguishable_from),
        "separate_by": f.separate_by,
    }


def _kept_json(record: Improvement, kept: Kept) -> dict[str, Any]:
    return to_table(kept.curve) | {"heldout_nll_drop_per_sample": kept.held_out / record.sample_count}
