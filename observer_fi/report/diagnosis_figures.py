"""The charts of a diagnosis, from Traces to panels: what was measured and predicted, what the verdict holds for how likely,
what told for it, and how well the winner fits.
"""

import numpy as np

from observer_fi.physics import (
    FAULTS,
    LABELS,
    NOMINAL,
    NOT_TESTED,
    OPEN_LOOP,
    channel_of,
    colour_of,
    mode_of,
    words_of,
)
from observer_fi.records import Array, Event, Isolation, Outcome, Traces
from observer_fi.report.interactive import INK, MUTED, TIME, Charts, Level, Mark, Panel, Series, View

MEASURED = "#3d444c"
ONSET = "#8a6100"
EVER = 0.02  # a hypothesis that was never likelier is not drawn
RIVALS = 3  # whose evidence is drawn from the start; the others' lines are a click away
BEFORE_S, AFTER_S, PAST_S = 0.03, 0.12, 0.03  # shown before an onset, after it, and after the isolation
FAR_S = 0.25  # before an onset whose interval begins earlier still
MOST_VIEWS = 40
FEWEST = 20  # samples of a view that is worth a button
SELDOM = 0.5  # share of the samples with a reading, below which a line goes from one to the next

BY_CHANNEL = (("voltage", "#8a6100"), ("current", "#0b62b0"), ("position", "#7a3b9a"))
# name, unit, factor from SI, narrowest range shown
CHANNELS = (
    ("Voltage", "V", 1.0, 0.05),
    ("Current", "mA", 1e3, 2.0),
    ("Position", "mm", 1e3, 0.05),
    ("Speed (V − Rm i)/Km", "rad/s", 1.0, 4.0),
)


def draw(outcome: Outcome) -> dict[str, Charts]:
    """All charts of an outcome by name; none where there is no verdict to show."""
    isolation, traces = outcome.isolation, outcome.overview
    if isolation is None or traces is None or isolation.verdict.label == NOT_TESTED or traces.t.size < 2:
        return {}
    panels = (*signals(traces, outcome.modes, isolation), posterior(traces, isolation),
              evidence(traces, outcome.modes, isolation.verdict), *by_channel(traces, outcome.modes, isolation.verdict),
              *innovations(traces))  # fmt: skip
    kept = tuple(view for view in views(isolation) if _is_full(traces, view))
    start = 0 if isolation.verdict.label != NOMINAL and kept else None
    drawn = {"log": Charts("log", panels, marks(isolation), kept, start)}
    if traces.mixture_t.size > 1:
        drawn["norms"] = Charts("norms", norms(traces, outcome.modes), marks(isolation))
    return drawn


def signals(traces: Traces, modes: tuple[str, ...], isolation: Isolation) -> list[Panel]:
    """Measured voltage, current, position and speed, with what the winner and the healthy model predict a sample ahead.

    Of a channel that is not measured nothing corrects the models: what they make of it is not drawn, of the speed the command is.
    """
    measured = [traces.z[:, 0], traces.z[:, 1], traces.z[:, 2], traces.w]
    predicted = [*(traces.predicted[:, :, c] for c in range(3)), traces.w_predicted]
    mode = mode_of(isolation.verdict.label, isolation.verdict.channel)
    drawn = [name for name in dict.fromkeys((mode, NOMINAL)) if name in modes]
    panels = []
    for r, (name, unit, factor, least) in enumerate(CHANNELS):
        if not np.isfinite(measured[r]).any():
            panels += [_commanded(traces)] if r == 3 and traces.w_cmd.any() else []
            continue
        seldom = float(np.isfinite(measured[r]).mean()) < SELDOM
        lines = [Series("measured", factor * measured[r], MEASURED, 1.2, spans=seldom)]
        for model, dash in zip(drawn, ((), (5, 3)), strict=False):
            y = factor * predicted[r][:, modes.index(model)]
            lines.append(Series(f"{words_of(model)}, predicted", y, colour_of(model), 1.4, dash))
        if r == 3:
            lines.append(Series("commanded", traces.w_cmd, MUTED, 1.2, (2, 3)))
        about = f"{name} over time: measured, and what {words_of(drawn[0])} predicts one sample ahead."
        panels.append(Panel(name, unit, traces.t, tuple(lines), about, link=TIME, least=least))
    return panels


def _commanded(traces: Traces) -> Panel:
    """The speed where nothing measures it."""
    line = Series("commanded", traces.w_cmd, MUTED, 1.2)
    about = "Commanded speed over time; nothing in this log measures the speed."
    return Panel("Speed", "rad/s", traces.t, (line,), about, link=TIME, least=CHANNELS[3][3])


def posterior(traces: Traces, isolation: Isolation) -> Panel:
    """Probability of every label that was ever likelier than one in fifty, as the verdicts have it."""
    channels = {event.label: event.channel for event in reversed((isolation.verdict, *isolation.events))}
    lines = [
        Series(_words(label, channels.get(label)), traces.posterior[:, k], colour_of(label, channels.get(label)), 2.0,
               two_bytes=True)
        for k, label in enumerate(LABELS)
        if traces.posterior[:, k].max() > EVER
    ]  # fmt: skip
    lines += [_whole_move(traces.t, event) for event in isolation.events if _told_afterwards(event)]
    last = LABELS[int(traces.posterior[-1].argmax())]
    about = f"Probability of each verdict over time; at the end of the log {_words(last)} is the likeliest."
    title = "Probability (dashed: 0.95, isolated)"
    return Panel(
        title, "", traces.t, tuple(lines), about, link=TIME, limits=(-0.03, 1.03), levels=(Level(0.95),)
    )


def _told_afterwards(event: Event) -> bool:
    """Whether a fault was told by the whole move only, after it had ended."""
    return event.label != NOMINAL and event.isolated_s is None


def _whole_move(t: Array, event: Event) -> Series:
    """What the whole move says of the time since the onset: a line beside those of the bank, which ran at that time."""
    begin = event.start_s if event.onset_s is None else event.onset_s
    y = np.where((t >= begin) & (t <= event.end_s), event.probability, np.nan)
    name = f"{_words(event.label, event.channel)}, by the whole move"
    return Series(name, y, colour_of(event.label, event.channel), 3.0, (8, 5), two_bytes=True)


def evidence(traces: Traces, modes: tuple[str, ...], verdict: Event) -> Panel:
    """By how many powers of ten the samples since the onset are likelier under the winner than under each rival.

    A verdict that is none of the bank's, told by the whole move, has no such curve: the bank's own stand against no fault.
    """
    mode = mode_of(verdict.label, verdict.channel)
    ours, winner = mode in modes, modes.index(mode if mode in modes else NOMINAL)
    odds = (traces.evidence[:, [winner]] - traces.evidence) / np.log(10.0) * (1.0 if ours else -1.0)
    known = verdict.end_s if verdict.isolated_s is None else verdict.isolated_s
    row = np.abs(odds[max(int(np.searchsorted(traces.t, known, "right")) - 1, 0)])
    absent = [name for c, (name, _) in enumerate(BY_CHANNEL) if not np.isfinite(traces.z[:, c]).any()]
    rivals = [j for j, m in enumerate(modes) if j != winner and channel_of(m) not in absent]
    order = sorted(rivals, key=lambda j: float(row[j]))
    against = "against {}" if ours else "{} against no fault"
    lines = tuple(
        Series(against.format(words_of(modes[j])), odds[:, j], colour_of(modes[j]), 1.6, shown=k < RIVALS)
        for k, j in enumerate(order)
    )
    since = "since the onset" if verdict.onset_s is not None else "since the move began"
    what = f"for {words_of(mode)}" if ours else f"in the bank, which has no model of {_words(verdict.label)},"
    about = f"Evidence {what} {since}, over time, in powers of ten of the odds."
    return Panel(f"Evidence {what} {since}", "powers of ten", traces.t, lines, about, link=TIME, least=2.0,
                 scale="asinh", levels=(Level(0.0),))  # fmt: skip


def by_channel(traces: Traces, modes: tuple[str, ...], verdict: Event) -> list[Panel]:
    """Which channel told a fault of the plant: what the winner leaves of it less than the healthy model does.

    A failed channel is judged by other rules than its residual, so a verdict on a sensor has no such picture.
    """
    mode = mode_of(verdict.label, verdict.channel)
    if mode not in OPEN_LOOP or mode == NOMINAL or mode not in modes:
        return []
    told = (traces.spared[:, modes.index(mode)] - traces.spared[:, modes.index(NOMINAL)]) / np.log(10.0)
    lines = tuple(
        Series(name, told[:, c], colour, 1.6)
        for c, (name, colour) in enumerate(BY_CHANNEL)
        if np.isfinite(traces.z[:, c]).any()
    )
    title = f"Which channel tells {words_of(mode)} from no fault"
    about = f"{title}: squared residuals over the noise that it spares since the onset, in powers of ten of the odds."
    return [Panel(title, "powers of ten", traces.t, lines, about, link=TIME, least=2.0, scale="asinh",
                  levels=(Level(0.0),), height=110)]  # fmt: skip


def innovations(traces: Traces) -> list[Panel]:
    """What the winner of each sample did not foresee, over its standard deviation."""
    panels = []
    for c, name in enumerate(("voltage", "current", "position")):
        y = np.clip(traces.normalised[:, c], -6.0, 6.0)
        if not np.isfinite(y).any():
            continue
        about = f"Innovations of the {name} in standard deviations; where the model fits, 95 % lie within the grey band."
        dots = (Series("innovation", y, MEASURED, 0.0, points=2.0, two_bytes=True),)
        panels.append(
            Panel(f"Surprise in the {name}", "standard deviations", traces.t, dots, about, link=TIME,
                  limits=(-6.3, 6.3), levels=(Level(-1.96, to=1.96),), height=90)
        )  # fmt: skip
    return panels


def norms(traces: Traces, modes: tuple[str, ...]) -> tuple[Panel, ...]:
    """Residual norms of equation 19 of the paper's three models: in the bank, and run open loop from the detection on."""
    shown = [(j, mode) for j, mode in enumerate(modes) if mode in OPEN_LOOP]
    bank = [
        Series(words_of(m), _positive(traces.norm[:, j]), colour_of(m), 0.0, points=2.5) for j, m in shown
    ]
    mixture = [
        Series(words_of(mode), _positive(traces.mixture_norm[:, j]), colour_of(mode), 1.6)
        for j, mode in enumerate(OPEN_LOOP)
    ]
    about = (
        "Norm of the residuals in current, position and speed of {}; the smallest is the best explanation."
    )
    return (
        Panel("Observer bank: residual norm", "", traces.t, tuple(bank), about.format("the bank's models"),
              link=TIME, scale="log", levels=(Level(3.0**0.5, "√3: noise"),), height=150),
        Panel("Open-loop mixture: residual norm", "", traces.mixture_t, tuple(mixture),
              about.format("the models run open loop"), link=TIME, scale="log", height=150),
    )  # fmt: skip


def marks(isolation: Isolation) -> tuple[Mark, ...]:
    """Onset with its interval, isolation and end of every fault, and the end of a move that told it only then."""
    found = []
    for event in (one for move in isolation.events for one in (move, *move.then) if one.label != NOMINAL):
        colour = colour_of(event.label, event.channel)
        low, high = event.onset_interval_s
        if event.onset_s is not None:
            found.append(Mark(event.onset_s, "onset", ONSET, low, high))
        if event.isolated_s is not None:
            found.append(Mark(event.isolated_s, "isolated", INK))
        else:
            found.append(Mark(event.end_s, "judged by the whole move", INK))
        if event.over_s is not None:
            found.append(Mark(event.over_s, "over", colour))
    return tuple(found)


def views(isolation: Isolation) -> tuple[View, ...]:
    """What the buttons lead to: each fault from before its onset to past its isolation, and its end; else the first start."""
    found = []
    for event in isolation.events:
        if event.label == NOMINAL:
            continue
        name, at = _words(event.label, event.channel), event.onset_s
        if at is not None:
            low = max(
                at - FAR_S, min(at, at if event.onset_interval_s[0] is None else event.onset_interval_s[0])
            )
            known = event.end_s if event.isolated_s is None else event.isolated_s
            found.append(View(f"{name}, {at:.3f} s", low - BEFORE_S, max(at + AFTER_S, known + PAST_S)))
            if known > at + 2.0 * AFTER_S:
                found.append(View(f"its first {1e3 * AFTER_S:.0f} ms", at - BEFORE_S, at + AFTER_S))
        else:
            found.append(View(name, event.start_s - BEFORE_S, event.end_s + PAST_S))
        if event.over_s is not None:
            found.append(View(f"its end, {event.over_s:.3f} s", event.over_s - 0.1, event.over_s + 0.1))
    if not found and isolation.events:
        at = isolation.events[0].start_s
        found.append(View(f"start of the first move, {at:.3f} s", at - 0.05, at + 0.15))
    return tuple(found[:MOST_VIEWS])


def _is_full(traces: Traces, view: View) -> bool:
    """Whether samples are there to be seen: of a log with many faults those of the first ones are kept."""
    inside = np.count_nonzero((traces.t >= view.low) & (traces.t <= view.high))
    return bool(inside >= FEWEST)


def captions(outcome: Outcome) -> dict[str, str]:
    """What each group of charts shows, {name: sentences}."""
    found = {
        "log": "Dark: measured; in colour what a model predicted one sample ahead. The data correct the models all the time, so "
        "they stay close; small differences add up to the evidence below. Evidence: by how many powers of ten the samples "
        "since the onset are likelier under the verdict than under a rival, on a scale that is logarithmic beyond one; "
        "which channel tells it is seen in the residuals that the verdict spares, each over its noise. Surprise: "
        "what the best model of each moment did not foresee; if it fits, 95 % of the dots lie in the grey band and show no "
        "pattern. Where samples are too many, extremes are kept; around the faults that the buttons lead to each one is there.",
        "norms": "Norm of the residuals in current, position and speed (equation 19). The mixture's models run open loop "
        "from the detection on: they never look at the data again, so they drift apart. Its norms are scaled by its constant "
        "standard deviations, the bank's by the noise of the sensors: the two have scales of their own.",
    }
    verdict = None if outcome.isolation is None else outcome.isolation.verdict
    if verdict is not None and verdict.label != NOMINAL and verdict.isolated_s is None:
        found["log"] += (
            " The verdict was not certain while the move ran: the thick dashed probability is what the whole move says."
        )
    return found


def _positive(y: Array) -> Array:
    return np.where(y > 0.0, y, np.nan)


def _words(label: str, channel: str | None = None) -> str:
    """A verdict in words, with its channel where it names one."""
    return FAULTS[label].title.lower() + (f" ({channel})" if channel else "")
