"""Results that show themselves: as text on `print`, as HTML in a notebook, as a table and as a figure on demand."""

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from html import escape
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from observer_fi import learn
from observer_fi.improve import Improvement
from observer_fi.logs import filtered_logger, told_filter, with_command, with_logger
from observer_fi.numerics import digits, with_error, with_unit
from observer_fi.physics import Rig
from observer_fi.records import Event, Fit, Log, Outcome
from observer_fi.report import comparison_page, trend_page
from observer_fi.report import diagnosis as diagnosis_report
from observer_fi.report import learning as learning_report
from observer_fi.trend import Trend

if TYPE_CHECKING:
    from observer_fi.report.still_figures import Figure

WIDE = 100  # characters of a line of text


def drawn() -> ModuleType:
    """The module that draws with matplotlib, which nothing else needs."""
    from observer_fi.report.results import figures

    return figures


def _text(warnings: Iterable[str], headline: str, *rest: str) -> str:
    """Warnings above the verdict, as on the terminal; then the rest, wrapped."""
    wrapped = [textwrap.fill(part, WIDE) for part in rest if part]
    return "\n".join([*(f"warning: {w}" for w in warnings), headline, *wrapped])


def _html(warnings: Iterable[str], headline: str, *rest: str, table: str = "") -> str:
    """The same for a notebook; table: HTML that stands below."""
    above = "".join(f"<p><b>Before you trust it:</b> {escape(w)}</p>" for w in warnings)
    below = "".join(f"<p>{escape(part)}</p>" for part in rest if part)
    return f"{above}<p><b>{escape(headline)}</b></p>{below}{table}"


@dataclass(frozen=True, repr=False)
class Result:
    """What every result can do. headline: one line; to_frame: its numbers; plot: its main picture."""

    @property
    def headline(self) -> str:
        """The result in one line."""
        raise NotImplementedError

    @property
    def warnings(self) -> tuple[str, ...]:
        """What changes how far the result can be trusted."""
        return ()

    def paragraphs(self) -> tuple[str, ...]:
        """What follows the headline, in sentences."""
        return ()

    def to_frame(self) -> pd.DataFrame:
        """The numbers of the result as a table."""
        raise NotImplementedError

    def figures(self) -> "dict[str, Figure]":
        """Every still figure of the result by its name, drawn by matplotlib."""
        raise NotImplementedError

    def plot(self) -> "Figure":
        """The main picture as a matplotlib figure: a notebook shows it, `savefig` writes it.

        Raises ValueError where there is nothing to draw, as of a log without a move.
        """
        for figure in self.figures().values():
            return figure
        raise ValueError(f"there is nothing to draw: {self.headline}")

    def __str__(self) -> str:
        return _text(self.warnings, self.headline, *self.paragraphs())

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.headline}>"

    def _repr_html_(self) -> str:
        return _html(self.warnings, self.headline, *self.paragraphs(), table=self._table())

    def _table(self) -> str:
        """The table of `to_frame` as HTML."""
        return str(self.to_frame().to_html(float_format=lambda v: digits(v, 4), na_rep=""))


@dataclass(frozen=True, repr=False)
class Diagnosis(Result):
    """The verdict on one log, with what it rests on."""

    outcome: Outcome
    rig: Rig

    @property
    def verdict(self) -> Event:
        """The log's verdict: label, channel, probability, onset and times [s]."""
        if self.outcome.isolation is None:
            raise ValueError(f"{self.outcome.name} has no verdict: {self.outcome.error}")
        return self.outcome.isolation.verdict

    @property
    def posterior(self) -> dict[str, float]:
        """Probability of each label at the verdict."""
        return dict(self.verdict.posterior)

    @property
    def headline(self) -> str:
        """The verdict in one line."""
        return diagnosis_report.headline(self.outcome)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What changes how far the verdict can be trusted."""
        return self.outcome.warnings

    @property
    def explanation(self) -> str:
        """One paragraph that a technician can act on."""
        return self.outcome.explanation

    def paragraphs(self) -> tuple[str, ...]:
        """The explanation, and what the log could have shown where there is no fault."""
        could = diagnosis_report.sensitivity(self.outcome.isolation) if self.outcome.isolation else ""
        return self.explanation, could

    def to_dict(self) -> dict[str, Any]:
        """What report.json holds."""
        return diagnosis_report.report_dict(self.outcome)

    def to_frame(self) -> pd.DataFrame:
        """Time [s], signals (SI) and the probability of each hypothesis; a long log is thinned, its extremes stay."""
        traces = self.outcome.overview
        if traces is None:
            raise ValueError(f"{self.outcome.name} has no traces: {self.outcome.error}")
        signals = {
            "time_s": traces.t, "voltage_v": traces.z[:, 0], "current_a": traces.z[:, 1], "position_m": traces.z[:, 2],
            "speed_rad_s": traces.w, "speed_cmd_rad_s": traces.w_cmd, "pitch_deg": traces.pitch,
        }  # fmt: skip
        return pd.DataFrame(
            signals | {f"p_{mode}": traces.probability[:, j] for j, mode in enumerate(self.outcome.modes)}
        )

    def figures(self) -> "dict[str, Figure]":
        """`verdict`: every sample around the onset; `whole_log`: all of it. None of a log that tells nothing."""
        found: dict[str, Figure] = drawn().of_diagnosis(self.outcome)
        return found

    def _table(self) -> str:
        p = pd.Series(self.posterior, name="probability").sort_values(ascending=False)
        return str(p.map(diagnosis_report.percent).to_frame().to_html())


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """A rig learned from its logs."""

    fit: Fit
    before: Rig
    logs: tuple[Log, ...]

    @cached_property
    def rig(self) -> Rig:
        """The rig with the values that were learned."""
        found = learn.identified_rig(self.fit, self.before)
        logs = [with_command(log, found) for log in self.logs] if found.driven.motor else self.logs
        learned = filtered_logger(with_logger(found, logs), self.fit.filters, logs[0].rate_hz)
        return learn.with_equation_errors(learned, logs, self.fit.filters)

    @property
    def headline(self) -> str:
        """One line: how much was learned."""
        untold = len(self.fit.not_identifiable)
        return f"{len(self.fit.parameters)} parameters learned" + (
            f", {untold} cannot be told" if untold else ""
        )

    verdict = headline

    @property
    def warnings(self) -> tuple[str, ...]:
        """Filters that the logger has before its readings, and what the equations leave out."""
        return (*map(told_filter, self.fit.filters), *self.fit.warnings)

    def paragraphs(self) -> tuple[str, ...]:
        """Each parameter with its standard error and what it was before; what cannot be told, and why."""
        learned = [
            f"  {p.name} = {with_error(p.value, p.std, p.unit)}  (was {with_unit(p.prior, p.unit)})"
            for p in self.fit.parameters
        ]
        untold = [f"  {name}: {why}" for name, why in self.fit.not_identifiable.items()]
        return (*learned, *(["Cannot be told from these logs:", *untold] if untold else []))

    def to_dict(self) -> dict[str, Any]:
        """What identify.json holds."""
        return learning_report.identify_json(self.fit)

    def to_frame(self) -> pd.DataFrame:
        """One row a parameter: value, standard error, 95 % interval, what it was before, unit (SI)."""
        return pd.DataFrame([vars(parameter) for parameter in self.fit.parameters]).set_index("name")

    def figures(self) -> "dict[str, Figure]":
        """`parameters`: values with their intervals, against those before; `correlation`: between them."""
        found: dict[str, Figure] = drawn().of_identification(self.fit)
        return found

    def _repr_html_(self) -> str:
        untold = [f"{name} cannot be told: {why}" for name, why in self.fit.not_identifiable.items()]
        return _html((), self.headline, *untold, table=self._table())


@dataclass(frozen=True, repr=False)
class Improved(Result):
    """What the simulation gets wrong, and the rig that has it."""

    record: Improvement
    before: Rig
    logs: tuple[Log, ...]

    @property
    def rig(self) -> Rig:
        """The rig with every cause that was named, or the one that does better on new moves."""
        return self.record.extended_rig

    @property
    def headline(self) -> str:
        """One line: what the simulation misses."""
        return learning_report.improve_headline(self.record)

    verdict = headline

    @property
    def warnings(self) -> tuple[str, ...]:
        """Filters that were taken out of the readings, and what else was done to them."""
        return (*map(told_filter, self.record.filters), *self.record.warnings)

    def paragraphs(self) -> tuple[str, ...]:
        """Each finding with its size and its gain on moves that no fit saw, and what would tell it from its rivals."""
        size, told = learning_report.reader_of(self.record), []
        for f in self.record.findings:
            sizes = ", ".join(
                f"{n} = {with_error(v.value, v.std, v.unit)}"
                for n, v in ((n, size(v)) for n, v in f.parameters.items())
            )
            told.append(
                f"{f.step}. {learning_report.plain(f.cause)} ({f.equation}): {sizes}; gains "
                f"{digits(f.heldout_nll_drop_per_sample)} nats a sample on moves that no fit saw"
                + (
                    f". Not told from {', '.join(f.indistinguishable_from)}"
                    if f.indistinguishable_from
                    else ""
                )
                + (f": {f.separate_by}" if f.indistinguishable_from and f.separate_by else "")
            )
        left = [
            f"Unexplained: {u.share:.0%} of the residual variance of {learning_report.EQUATIONS[u.equation]} goes with "
            f"{learning_report.goes_with(u)}"
            for u in self.record.unexplained
        ]
        return (*told, *left)

    def to_dict(self) -> dict[str, Any]:
        """What improve.json holds, without what `diagnose` gains."""
        return learning_report.improve_json(self.record, None)

    def to_frame(self) -> pd.DataFrame:
        """One row a finding: cause, equation, evidence, and what it gains on moves that no fit saw."""
        columns = ("cause", "equation", "variant", "delta_bic", "heldout_nll_drop_per_sample", "separate_by")
        rows = [[getattr(finding, name) for name in columns] for finding in self.record.findings]
        return pd.DataFrame(rows, columns=pd.Index(columns))

    def figures(self) -> "dict[str, Figure]":
        """`improvement`: what each cause gains; `residuals`: over the moves and over what they go with, before and after."""
        found: dict[str, Figure] = drawn().of_improvement(self.record)
        return found


@dataclass(frozen=True, repr=False)
class Life(Result):
    """What changed over an actuator's logs. unreadable: one line for each log that could not be used."""

    record: Trend
    unreadable: tuple[str, ...] = ()

    @property
    def headline(self) -> str:
        """One line: what changed, since when, by how much."""
        return trend_page.headline(self.record)

    verdict = headline

    @property
    def warnings(self) -> tuple[str, ...]:
        """Logs that could not be used."""
        return self.unreadable

    def paragraphs(self) -> tuple[str, ...]:
        """When a limit will be reached, what the healthy state is, and what the order of the logs comes from."""
        ahead = [a.words for a in self.record.aheads]
        return (*ahead, f"Healthy is {self.record.baseline_from}. Order: {self.record.ordered_by}.")

    def to_dict(self) -> dict[str, Any]:
        """What trend.json holds."""
        return trend_page.trend_json(self.record, list(self.unreadable))

    def to_frame(self) -> pd.DataFrame:
        """One row a log: path, time, verdict, score (1 is the limit), and every quantity that it tells (SI)."""
        rows = [
            {"path": j.digest.path, "time": j.digest.time, "verdict": j.verdict, "score": j.score}
            | dict(zip(j.digest.names, np.asarray(j.digest.value).tolist(), strict=True))
            for j in self.record.logs
        ]
        return pd.DataFrame(rows)

    def figures(self) -> "dict[str, Figure]":
        """`trend`: the score and the quantities that changed, log by log."""
        found: dict[str, Figure] = drawn().of_trend(self.record)
        return found


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """The bank against the open-loop mixture; record: what compare.json holds."""

    record: dict[str, Any]

    @property
    def headline(self) -> str:
        """One line: how often each of them is right."""
        shares = [
            f"{name} {100.0 * self.record[judge]['accuracy']:.1f} %"
            for judge, name in comparison_page.JUDGES.items()
        ]
        return f"right on {len(self.record['cases'])} logs: {', '.join(shares)}"

    verdict = headline

    def __str__(self) -> str:
        return f"{self.headline}\n{comparison_page.table(self.record)}"

    def to_dict(self) -> dict[str, Any]:
        """What compare.json holds."""
        return self.record

    def to_frame(self) -> pd.DataFrame:
        """One row a log: its truth, and verdict, probability and delay [s] of either judge."""
        return pd.json_normalize(self.record["cases"])

    def figures(self) -> "dict[str, Figure]":
        """`delays`: every time from the onset to the isolation."""
        found: dict[str, Figure] = drawn().of_comparison(self.record)
        return found

    def _table(self) -> str:
        return f"<pre>{escape(comparison_page.table(self.record))}</pre>"
