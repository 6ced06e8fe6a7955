"""Still figures of results, {name: figure}: what a result's `plot()` shows and `--figures` writes beside its page."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from observer_fi.improve import Improvement, Residuals
from observer_fi.numerics import digits, readable, with_error
from observer_fi.physics import NOMINAL, NOT_TESTED, colour_of, mode_of, words_of
from observer_fi.plan import Plan, course
from observer_fi.records import Array, Event, Fit, Isolation, Outcome, Parameter, Traces
from observer_fi.report.diagnosis import headline
from observer_fi.report.diagnosis_figures import posterior
from observer_fi.report.plan_page import headline as headline_of_plan
from observer_fi.report.still_figures import (
    INK,
    MEASURED,
    MUTED,
    Axes,
    Figure,
    delay_figure,
    sheet,
    still_files,
)
from observer_fi.trend import CHANGED, UNCHANGED, Trend, in_words
from observer_fi.trend import NOT_TESTED as UNTOLD

WIDTH = 9.0  # inches
BEFORE, AFTER = "#b4560f", "#0b62b0"
SIGNALS = (("voltage", "V", 1.0), ("current", "mA", 1e3), ("position", "mm", 1e3), ("speed", "rad/s", 1.0))
BAND = 1.96  # 95 % of innovations lie within, where the model fits
LANES = 6
STATES = {UNCHANGED: ("#3d6fa8", "o"), CHANGED: ("#b3261e", "s"), UNTOLD: ("#8a929b", "x")}


# --- a diagnosis -------------------------------------------------------------------------------------


def of_diagnosis(outcome: Outcome) -> dict[str, Figure]:
    """Signals, residuals and probabilities: every sample around the onset, and the whole log; none where nothing was judged."""
    zoom, whole, isolation = outcome.zoom, outcome.overview, outcome.isolation
    if zoom is None or whole is None or isolation is None or isolation.verdict.label == NOT_TESTED:
        return {}
    near = zoom if zoom.t.size > 1 else whole
    events = [one for event in isolation.events for one in (event, *event.then)]
    return {
        "verdict": _evidence(near, outcome, isolation, [isolation.verdict]),
        "whole_log": _evidence(whole, outcome, isolation, events),
    }


def _evidence(traces: Traces, outcome: Outcome, isolation: Isolation, events: Sequence[Event]) -> Figure:
    """Measured and predicted signals, innovations of the winner, and the posterior, on one time axis."""
    verdict = isolation.verdict
    heights = {"height_ratios": (1.0, 1.0, 1.0, 1.0, 1.0, 0.8, 1.2)}
    with sheet((WIDTH, 10.8), 7, 1, sharex=True, gridspec_kw=heights) as (figure, column):
        shown = dict.fromkeys((NOMINAL, mode_of(verdict.label, verdict.channel)))
        rows = [outcome.modes.index(name) for name in shown if name in outcome.modes]
        _signals(column[:4], traces, outcome.modes, rows)
        _norms(column[4], traces, outcome.modes, rows)
        _innovations(column[5], traces)
        _posterior(column[6], traces, isolation)
        for axes in column:
            _events(axes, traces, events)
        _event_words(column[0], traces, verdict)
        column[6].set_xlabel("time [s]")
        column[6].set_xlim(float(traces.t[0]), float(traces.t[-1]))
        figure.align_ylabels(column)
        figure.suptitle(f"{outcome.name}: {headline(outcome)}", x=0.01, ha="left", fontweight="bold")
    return figure


def _signals(column: Sequence[Axes], traces: Traces, modes: Sequence[str], rows: Sequence[int]) -> None:
    """Each signal as measured, and as these hypotheses predicted it one sample ahead."""
    measured = (*traces.z.T, traces.w)
    predicted = (*np.moveaxis(traces.predicted, 2, 0), traces.w_predicted)
    for axes, y, model, (name, unit, scale) in zip(column, measured, predicted, SIGNALS, strict=True):
        axes.plot(traces.t, scale * y, color=MEASURED, linewidth=2.2, alpha=0.35, label="measured")
        for j in rows:
            label = f"predicted: {words_of(modes[j])}"
            axes.plot(traces.t, scale * model[:, j], color=colour_of(modes[j]), linewidth=0.9, label=label)
        axes.set_ylim(*_limits(scale * y, scale * model[:, rows]))
        axes.set_ylabel(f"{name} [{unit}]")
    column[0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _limits(measured: Array, predicted: Array) -> tuple[float, float]:
    """The range of the data, and of predictions as far as they leave it by half its height."""
    seen = measured[np.isfinite(measured)]
    if not seen.size:
        return -1.0, 1.0
    low, high = float(seen.min()), float(seen.max())
    room = 0.5 * (high - low) or 0.5
    model = np.clip(predicted[np.isfinite(predicted)], low - room, high + room)
    low, high = min([low, *model.tolist()]), max([high, *model.tolist()])
    return low - 0.1 * room, high + 0.1 * room


def _norms(axes: Axes, traces: Traces, modes: Sequence[str], rows: Sequence[int]) -> None:
    """How far the predictions of these hypotheses are off: the norm of equation 19, which noise alone holds at sqrt(3)."""
    for j in rows:
        norm = np.where(traces.norm[:, j] > 0.0, traces.norm[:, j], np.nan)
        colour = colour_of(modes[j])
        axes.semilogy(
            traces.t, norm, color=colour, linewidth=0.7, alpha=0.8, label=f"off: {words_of(modes[j])}"
        )
    axes.axhline(3.0**0.5, color=MUTED, linewidth=0.8, linestyle=":", label="noise alone")
    axes.set(ylabel="residual [1]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _innovations(axes: Axes, traces: Traces) -> None:
    """Innovations of the winner over their standard deviations, a colour a channel, with the band of 95 %."""
    axes.axhspan(-BAND, BAND, color="#eef0f3", zorder=0)
    for c, (name, colour) in enumerate(
        (("voltage", "#7a5195"), ("current", "#0b8a6a"), ("position", "#d1495b"))
    ):
        y = np.clip(traces.normalised[:, c], -5.8, 5.8)
        axes.plot(traces.t, y, ".", color=colour, markersize=2.2, alpha=0.5, label=name, rasterized=True)
    axes.set(ylabel="innovation [std]", ylim=(-6.0, 6.0))
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, markerscale=4.0)


def _posterior(axes: Axes, traces: Traces, isolation: Isolation) -> None:
    """The probability of every verdict as the page draws it, with what the whole move says beside what the bank said."""
    for line in posterior(traces, isolation).series:
        axes.plot(
            traces.t, line.y, color=line.colour, linewidth=0.7 * line.width, dashes=line.dash or (None, None), label=line.name
        )  # fmt: skip
    axes.axhline(0.95, color=MUTED, linewidth=0.8, linestyle=":")
    axes.set(ylabel="probability [1]", ylim=(-0.03, 1.03))
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _events(axes: Axes, traces: Traces, events: Sequence[Event]) -> None:
    """Onset with its interval, and the moment from which a verdict is certain."""
    first, last = float(traces.t[0]), float(traces.t[-1])
    for event in events:
        low, high = event.onset_interval_s
        if low is not None and high is not None and high >= first and low <= last:
            axes.axvspan(max(low, first), min(high, last), color="#f0b429", alpha=0.35, linewidth=0.0)
        for moment, line in ((event.onset_s, "-"), (event.isolated_s, "--")):
            if event.label != NOMINAL and moment is not None and first <= moment <= last:
                axes.axvline(moment, color=INK, linewidth=0.8, linestyle=line)


def _event_words(axes: Axes, traces: Traces, verdict: Event) -> None:
    """What the lines are, above the topmost axes, away from each other."""
    first, last = float(traces.t[0]), float(traces.t[-1])
    for name, moment, side in (
        ("onset ", verdict.onset_s, "right"),
        (" isolated", verdict.isolated_s, "left"),
    ):
        if verdict.label != NOMINAL and moment is not None and first <= moment <= last:
            at = axes.get_xaxis_transform()
            axes.text(moment, 1.03, name, transform=at, color=MUTED, fontsize=8, ha=side)


# --- what was learned --------------------------------------------------------------------------------


def of_identification(fit: Fit) -> dict[str, Figure]:
    """Values with their intervals against those before, and how the errors go together."""
    found = {"parameters": _intervals(fit.parameters)}
    if len(fit.parameters) > 1 and np.asarray(fit.correlation).size:
        found["correlation"] = _correlation(fit)
    return found


def _intervals(parameters: Sequence[Parameter]) -> Figure:
    """One row a parameter: its change in per cent of what it was, with its 95 % interval, and the value in words."""
    with sheet((WIDTH, 0.42 * len(parameters) + 1.5)) as (figure, axes):
        for row, p in enumerate(parameters):
            told = with_error(p.value, p.std, p.unit)
            axes.text(
                1.02, row, told, transform=axes.get_yaxis_transform(), va="center", color=MUTED, fontsize=8
            )
            if not np.isfinite(p.prior) or p.prior == 0.0:
                continue
            middle, low, high = (100.0 * (v / p.prior - 1.0) for v in (p.value, p.low, p.high))
            axes.plot([low, high], [row, row], color=AFTER, linewidth=2.0)
            axes.plot(middle, row, "o", color=AFTER, markersize=5.0)
        axes.axvline(0.0, color=INK, linewidth=0.9, linestyle=":")
        _per_cent_axis(axes)
        axes.set_yticks(range(len(parameters)), [p.name for p in parameters])
        axes.set_ylim(len(parameters) - 0.5, -0.5)
        axes.set(xlabel="change against the rig before [%]", title="Learned values with their 95 % intervals")
    return figure


def _per_cent_axis(axes: Axes) -> None:
    """Changes of a few per cent and of thousands on one axis: linear up to 10 %, logarithmic beyond."""
    low, high = axes.get_xlim()
    axes.set_xscale("symlog", linthresh=10.0)
    ticks = [sign * at for at in (3, 10, 30, 100, 300, 1000, 10000) for sign in (-1, 1)] + [0]
    shown = [tick for tick in sorted(ticks) if low <= tick <= high]
    axes.set_xticks(shown, [f"{tick:+d}" if tick else "0" for tick in shown])
    axes.minorticks_off()
    axes.set_xlim(low, high)


def _correlation(fit: Fit) -> Figure:
    """The correlation matrix as shaded squares, with numbers where they can be read."""
    names, matrix = [p.name for p in fit.parameters], np.asarray(fit.correlation, dtype=float)
    count = len(matrix)
    with sheet((0.5 * count + 2.2, 0.5 * count + 1.3)) as (figure, axes):
        axes.grid(visible=False)
        shown = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        for row, column in np.ndindex(matrix.shape):
            value = float(matrix[row, column])
            if np.isfinite(value) and row != column:
                colour = "white" if abs(value) > 0.6 else INK
                axes.text(
                    column,
                    row,
                    f"{round(value, 2) + 0.0:.2f}",
                    ha="center",
                    va="center",
                    fontsize=7,
                    color=colour,
                )
        axes.set_xticks(range(count), names[:count], rotation=45, ha="right")
        axes.set_yticks(range(count), names[:count])
        axes.set_title("Correlation of the errors")
        figure.colorbar(shown, ax=axes, shrink=0.8, label="correlation [1]")
    return figure


# --- what the simulation gets wrong ------------------------------------------------------------------


def of_improvement(record: Improvement) -> dict[str, Figure]:
    """What each cause gains, and the residuals before and after it was put in."""
    found = {"improvement": _gains(record)} if record.findings else {}
    return found | {"residuals": _residuals(record.before, record.after)}


def _gains(record: Improvement) -> Figure:
    """A bar a cause, its rivals beside it, and the root mean squares of held-out moves with it over those without."""
    findings = record.findings
    with sheet((WIDTH, 0.5 * len(findings) + 1.4)) as (figure, axes):
        gains = [f.heldout_nll_drop_per_sample for f in findings]
        axes.barh(range(len(findings)), gains, color=AFTER, height=0.55)
        for row, f in enumerate(findings):
            rivals = ", ".join(name.replace("_", " ") for name in f.indistinguishable_from)
            words = digits(f.heldout_nll_drop_per_sample) + (f"  or {rivals}" if rivals else "")
            axes.annotate(
                words, (max(gains[row], 0.0), row), xytext=(4, 0), textcoords="offset points", va="center"
            )
        names = [f"{f.cause.replace('_', ' ')}\n({f.equation})" for f in findings]
        axes.set_yticks(range(len(findings)), names)
        axes.set_ylim(len(findings) - 0.5, -0.5)
        axes.set_xlim(min(0.0, *gains), 1.35 * max(*gains, 1e-9))
        axes.set(
            xlabel="held-out gain [nats a sample]", title="What each cause gains on moves that no fit saw"
        )
    return figure


def _residuals(before: Residuals, after: Residuals) -> Figure:
    """Residuals of every channel along the moves, before and after."""
    count = len(before.channels)
    step = float(np.median(np.diff(before.t))) if before.t.size > 1 else 0.0
    along = step * np.arange(before.t.size)
    with sheet((WIDTH, 1.9 * count + 0.9), count, 1, sharex=True, squeeze=False) as (figure, grid):
        for c, axes in enumerate(grid[:, 0]):
            axes.plot(
                along, before.z_minus_y[:, c], color=BEFORE, linewidth=0.6, alpha=0.75, label="refitted rig"
            )
            axes.plot(along, after.z_minus_y[:, c], color=AFTER, linewidth=0.6, label="extended rig")
            low, high = np.nanquantile(before.z_minus_y[:, c], [0.001, 0.999])
            room = 0.15 * max(float(high - low), 1e-12)
            axes.set_ylim(float(low) - room, float(high) + room)
            axes.set_ylabel(f"{before.channels[c]} [{before.unit}]")
        grid[0, 0].set_title("What the simulation leaves")
        grid[0, 0].legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        grid[-1, 0].set_xlabel("time along the moves [s]")
        figure.align_ylabels(grid[:, 0])
    return figure


# --- a life, and a comparison ------------------------------------------------------------------------


def of_plan(plan: Plan) -> dict[str, Figure]:
    """The planned and the simpler command over time, travel below, and pitch where there are several; nothing without moves."""
    if not plan.planned.blocks:
        return {}
    planned, simpler = (course(profile, plan.limits) for profile in (plan.planned, plan.simpler))
    pitched = len(plan.limits.pitches) > 1
    with sheet((WIDTH, 5.0 + 1.4 * pitched), 3 + pitched, 1, sharex=True) as (figure, column):
        unit, factor = readable("m", float(np.abs(planned.x).max()))
        column[0].plot(planned.t, planned.w, color=AFTER)
        column[1].plot(planned.t, factor * planned.x, color=AFTER)
        column[-1].plot(simpler.t, simpler.w, color=MUTED)
        column[-1].set_title("the simpler moves", fontweight="normal")
        for axes, label in zip(column, ("speed [rad/s]", f"travel [{unit}]"), strict=False):
            axes.set_ylabel(label)
        column[-1].set(ylabel="speed [rad/s]", xlabel="time [s]")
        if pitched:
            column[2].plot(planned.t, planned.pitch, color=AFTER, drawstyle="steps-post")
            column[2].set_ylabel("pitch [deg]")
        figure.align_ylabels(column)
        figure.suptitle(headline_of_plan(plan), x=0.01, ha="left", fontweight="bold")
    return {"command": figure}


def of_trend(found: Trend) -> dict[str, Figure]:
    """The score of every log, and below it the quantities that changed, or else the first ones, log by log."""
    rows = _lane_rows(found)
    with sheet((WIDTH, 1.5 * (len(rows) + 1) + 0.9), len(rows) + 1, 1, sharex=True, squeeze=False) as (
        figure,
        grid,
    ):
        places = {path: k for k, path in enumerate(found.table.paths, start=1)}
        _scores(grid[0, 0], found, places)
        for axes, row in zip(grid[1:, 0], rows, strict=True):
            _lane(axes, found, row, places)
        for finding in found.findings:
            at = places.get(found.paths[finding.row])
            for axes in grid[:, 0] if at is not None else ():
                axes.axvline(at, color=STATES[CHANGED][0], linewidth=0.9, linestyle="--")
        grid[-1, 0].set_xlabel("number of the log, in order")
        grid[-1, 0].xaxis.get_major_locator().set_params(integer=True)
        figure.align_ylabels(grid[:, 0])
    return {"trend": figure}


def _lane_rows(found: Trend) -> list[int]:
    """Quantities of changes first, then by how far they went in a log, then the others."""
    names = found.baseline.names
    first = [names.index(n) for f in found.findings for n in f.names]
    first += [names.index(m.name) for j in found.logs for m in j.changed]
    return list(dict.fromkeys([*first, *range(len(names))]))[:LANES]


def _states(found: Trend, places: Mapping[str, int]) -> dict[str, str]:
    """Verdict of every log of the table; those of the baseline have none and count as unchanged."""
    judged = {j.digest.path: j.verdict for j in found.logs}
    return {path: judged.get(path, UNCHANGED) for path in places}


def _scores(axes: Axes, found: Trend, places: Mapping[str, int]) -> None:
    judged = [j for j in found.logs if j.verdict != UNTOLD and j.digest.path in places]
    for state, (colour, mark) in STATES.items():
        here = [(places[j.digest.path], j.score) for j in judged if j.verdict == state]
        if here:
            axes.plot(
                *zip(*here, strict=True), mark, color=colour, markersize=4.0, label=state.replace("_", " ")
            )
    axes.axhline(1.0, color=MUTED, linewidth=0.9, linestyle=":")
    axes.set(
        ylabel="score [1]",
        title=f"Distance from the baseline (limit: one false alarm in {digits(1.0 / found.rate, 4)} logs)",
    )
    axes.set_ylim(0.0, None)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


def _lane(axes: Axes, found: Trend, row: int, places: Mapping[str, int]) -> None:
    """One quantity over the logs, with the healthy band."""
    name, unit = found.baseline.names[row], found.baseline.units[row]
    middle = float(found.baseline.coefficients[0, row])
    half = float(found.baseline.limit_of * found.baseline.scatter[row])
    seen = found.table.value[:, found.table.names.index(name)] if name in found.table.names else np.empty(0)
    unit, factor = readable(unit, float(np.nanmax(np.abs(np.append(seen, middle)))))
    middle, half = factor * middle, factor * half
    axes.axhspan(middle - half, middle + half, color="#9fb4c9", alpha=0.3, linewidth=0.0)
    if seen.size:
        values = factor * seen
        states = list(_states(found, places).values())
        for state, (colour, mark) in STATES.items():
            here = np.flatnonzero(np.array([s == state for s in states]))
            axes.plot(here + 1, values[here], mark, color=colour, markersize=3.5)
    axes.set_ylabel(f"[{unit or 1}]")
    axes.set_title(f"{in_words(name)} ({name})", fontsize=8, fontweight="normal")


def of_comparison(result: Mapping[str, Any]) -> dict[str, Figure]:
    """Every time from the onset to the isolation, by fault, phase and judge."""
    return {"delays": delay_figure(result["cases"])}


# --- by command --------------------------------------------------------------------------------------

OF_COMMAND: dict[str, Callable[[Any], dict[str, Figure]]] = {
    "diagnose": of_diagnosis,
    "identify": of_identification,
    "improve": of_improvement,
    "trend": of_trend,
    "compare": of_comparison,
    "plan": of_plan,
}


def stills_of(command: str, record: Any, kind: str) -> dict[str, bytes]:
    """The figures of a command's record as files, {file name: content}. kind: png, svg or pdf."""
    return still_files(OF_COMMAND[command](record), kind)
