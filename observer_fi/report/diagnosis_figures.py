"""The figures of a report, from Traces to SVG: what was measured, what was predicted, and how far apart."""

import numpy as np

from observer_fi.physics import NOMINAL, OPEN_LOOP, Rig, colour_of, mode_of, words_of
from observer_fi.physics import paper_residuals as residual
from observer_fi.records import Array, Event, Outcome, Traces
from observer_fi.report.chart import INK, MUTED, Figure, Panel, padded

WIDTH, LEFT, RIGHT, GAP = 1040.0, 46.0, 104.0, 150.0
ROW, SPACE, TOP = 118.0, 34.0, 64.0
DOTS = 2500  # innovations drawn a channel
MEASURED = "#3d444c"
ONSET = "#f0b429"

# name, unit, factor from SI, narrowest range shown
CHANNELS = (
    ("Voltage", "V", 1.0, 0.05),
    ("Current", "mA", 1e3, 2.0),
    ("Position", "mm", 1e3, 0.05),
    ("Speed (V − Rm i)/Km", "rad/s", 1.0, 4.0),
)


def draw(outcome: Outcome, rig: Rig) -> dict[str, str]:
    """All figures of an outcome, {name: SVG}, in the order in which a report shows them."""
    if (
        outcome.zoom is None
        or outcome.overview is None
        or outcome.isolation is None
        or outcome.zoom.t.size < 2
    ):
        return {}
    verdict = outcome.isolation.verdict
    shown = _drawn_modes(outcome)
    return {
        "signals": signals(outcome.zoom, outcome.modes, shown, verdict, rig.model.vector),
        "residuals": residuals(outcome.overview, outcome.zoom, outcome.modes, shown, verdict),
        "posterior": posterior(outcome.zoom, outcome.modes, verdict),
        "overview": overview(outcome.overview, outcome.modes, verdict, outcome.isolation.events),
        "consistency": consistency(outcome.overview),
    }


def captions(outcome: Outcome) -> dict[str, str]:
    """What each figure shows, {name: sentences}."""
    healthy = outcome.isolation is None or outcome.isolation.verdict.label == NOMINAL
    beside = outcome.zoom is not None and outcome.zoom.mixture_t.size > 1
    where = "at the start of the move" if healthy else "around the onset"
    found = {
        "signals": f"Every sample {where} (dark: measured), and what each observer of the bank predicted one "
        "sample ahead. The data correct all of them, so they stay close; small differences add up to "
        "the verdict.",
        "residuals": "Norm of the residuals in current, position and speed (equation 19), with its "
        "running root "
        "mean square in bold: the smallest belongs to the best explanation. The bank's residuals are "
        "scaled by "
        "the noise of the sensors.",
        "posterior": "Probability of each hypothesis. A verdict counts as isolated when it stays above 0.95 "
        "(dashed).",
        "overview": "The whole log (dark: measured, extremes kept where samples are too many to draw), "
        "with what "
        "the winning observer predicted one sample ahead, in its colour, and the probabilities below.",
        "consistency": "Innovations of the winning observer over their standard deviations. If the "
        "model fits, "
        "95 % lie within the grey band and they show no pattern.",
    }
    if beside:
        found["signals"] += (
            " Right, the paper's models run open loop from the detection on: they never look at the "
            "data again, "
            "so they drift apart."
        )
        found["residuals"] += (
            " The mixture's are scaled by its constant standard deviations, so the two sides have scales of "
            "their own."
        )
        found["posterior"] += " The mixture's comes from its residual norms: Gaussians of equal weight."
    return found


def _drawn_modes(outcome: Outcome) -> tuple[int, ...]:
    """The three models of the paper, and the winner where it is another."""
    assert outcome.isolation is not None
    verdict = outcome.isolation.verdict
    names = dict.fromkeys((*OPEN_LOOP, mode_of(verdict.label, verdict.channel)))
    return tuple(outcome.modes.index(name) for name in names if name in outcome.modes)


def signals(traces: Traces, modes: tuple[str, ...], shown: tuple[int, ...], verdict: Event, p: Array) -> str:
    """Voltage, current, position and speed around the onset: the bank's predictions and the mixture's."""
    span = _span(traces.t)
    there = (traces.mixture_t >= span[0]) & (traces.mixture_t <= span[1])
    two = bool(there.sum() > 1)
    figure = _sheet("signals", 4, "Measured signals and predictions around the onset")
    boxes = _columns(2 if two else 1)
    measured = _measured(traces)
    predicted = _predicted(traces)
    mixture = traces.mixture_predicted[there]
    drifting = [*(mixture[:, :, c] for c in range(3)), residual.speed(mixture, p)]
    _heads(figure, boxes, ("Observer bank: one sample ahead", "Open-loop mixture: from the detection on"))
    for row, (name, unit, factor, least) in enumerate(CHANNELS):
        y = factor * measured[row]
        top = TOP + row * (ROW + SPACE)
        limits = _limits(y, factor * predicted[row][:, list(shown)], least)
        for column, (left, width) in enumerate(boxes):
            panel = figure.panel(left, top, width, ROW, span, limits)
            panel.frame("time [s]" if row == 3 else "", f"{name} [{unit}]", x_ticks=row == 3)
            _events(panel, verdict, words=row == 0)
            panel.line(traces.t, y, MEASURED, 0.8, opacity=0.55)
            if column == 0:
                _hypotheses(panel, traces.t, factor * predicted[row], modes, shown)
            else:
                _mixture(panel, traces.mixture_t[there], factor * drifting[row])
    return figure.svg()


def _mixture(panel: Panel, t: Array, curves: Array) -> None:
    labels = []
    for j, mode in enumerate(OPEN_LOOP):
        panel.line(t, curves[:, j], colour_of(mode), 1.8)
        labels.append((_last(curves[:, j]), words_of(mode), colour_of(mode)))
    panel.end_labels(labels)


def _hypotheses(
    panel: Panel, t: Array, curves: Array, modes: tuple[str, ...], shown: tuple[int, ...]
) -> None:
    labels = []
    for j in shown:
        colour = colour_of(modes[j])
        panel.line(t, curves[:, j], colour, 1.1, opacity=0.9)
        labels.append((_last(curves[:, j]), words_of(modes[j]), colour))
    panel.end_labels(labels)


def residuals(
    whole: Traces, zoom: Traces, modes: tuple[str, ...], shown: tuple[int, ...], verdict: Event
) -> str:
    """Residual norms against time on a logarithmic scale: bank and mixture side by side."""
    two = whole.mixture_t.size > 1
    traces, span = zoom, _span(zoom.t)
    if two:
        start, stop = float(whole.mixture_t[0]), float(whole.mixture_t[-1])
        wide = (start - 0.1 * (stop - start), stop)
        if np.count_nonzero((whole.t >= wide[0]) & (whole.t <= wide[1])) > 300:
            traces, span = whole, wide
    figure = _sheet("residuals", 1, "Residual norm of each model", row=190.0)
    boxes = _columns(2 if two else 1)
    _heads(figure, boxes, ("Observer bank", "Open-loop mixture"))
    here = (traces.t >= span[0]) & (traces.t <= span[1])
    bank = figure.panel(
        boxes[0][0], TOP, boxes[0][1], 190.0, span, _decades(traces.norm[here][:, list(shown)]), True
    )
    names = [modes[j] for j in shown]
    _norms(bank, traces.t[here], traces.norm[here][:, list(shown)], names, verdict, noise=3.0**0.5)
    if two:
        there = (whole.mixture_t >= span[0]) & (whole.mixture_t <= span[1])
        if there.sum() < 2:  # a long log, whose drawn samples lie elsewhere
            there, span = np.ones(whole.mixture_t.size, dtype=np.bool_), _span(whole.mixture_t)
        norm = whole.mixture_norm[there]
        panel = figure.panel(boxes[1][0], TOP, boxes[1][1], 190.0, span, _decades(norm), True)
        _norms(panel, whole.mixture_t[there], norm, list(OPEN_LOOP), verdict)
    return figure.svg()


def _norms(
    panel: Panel, t: Array, norm: Array, names: list[str], verdict: Event, noise: float | None = None
) -> None:
    panel.frame("time [s]", "residual norm")
    _events(panel, verdict)
    labels = []
    for j, mode in enumerate(names):
        panel.line(t, norm[:, j], colour_of(mode), 0.5, opacity=0.14)
    for j, mode in enumerate(names):
        smooth = _running_rms(norm[:, j], max(5, t.size // 60))
        panel.line(t, smooth, colour_of(mode), 2.0)
        labels.append((_last(smooth), words_of(mode), colour_of(mode)))
    if noise is not None:
        panel.level(noise)
        labels.append((noise, "√3: noise", MUTED))
    panel.end_labels(labels)


def posterior(traces: Traces, modes: tuple[str, ...], verdict: Event) -> str:
    """Probability of each hypothesis around the onset: the bank's, and the mixture's beside it."""
    span = _span(traces.t)
    there = (traces.mixture_t >= span[0]) & (traces.mixture_t <= span[1])
    two = bool(there.sum() > 1)
    figure = _sheet("posterior", 1, "Probability of each hypothesis against time", row=150.0)
    boxes = _columns(2 if two else 1)
    _heads(figure, boxes, ("Observer bank", "Open-loop mixture"))
    bank = figure.panel(boxes[0][0], TOP, boxes[0][1], 150.0, span, (-0.03, 1.03))
    bank.frame("time [s]", "probability")
    _events(bank, verdict, words=True)
    _probabilities(bank, traces.t, traces.probability, modes)
    if two:
        # Gaussians of equal weight: the residual norm says it all (mixture.py)
        squared = traces.mixture_norm[there] ** 2
        likelihood = np.exp(-0.5 * (squared - squared.min(axis=1, keepdims=True)))
        panel = figure.panel(boxes[1][0], TOP, boxes[1][1], 150.0, span, (-0.03, 1.03))
        panel.frame("time [s]", "probability")
        _events(panel, verdict)
        _probabilities(
            panel, traces.mixture_t[there], likelihood / likelihood.sum(axis=1, keepdims=True), OPEN_LOOP
        )
    return figure.svg()


def _probabilities(panel: Panel, t: Array, probability: Array, modes: tuple[str, ...]) -> None:
    """Lines of the hypotheses that were ever likelier than one in fifty, and the level of isolation."""
    panel.level(0.95)
    labels = []
    for j, mode in enumerate(modes):
        p = probability[:, j]
        if np.nanmax(p) > 0.02:
            panel.line(t, p, colour_of(mode), 1.8)
            labels.append((_last(p), words_of(mode), colour_of(mode)))
    panel.end_labels(labels)


def overview(traces: Traces, modes: tuple[str, ...], verdict: Event, events: tuple[Event, ...]) -> str:
    """The whole log: signals with the winner's prediction, and probabilities."""
    row = 88.0
    figure = _sheet("overview", 5, "The whole log", row=row, top=30.0)
    left, width = _columns(1)[0]
    span = _span(traces.t)
    winner = traces.probability.argmax(axis=1)
    k = np.arange(traces.t.size)
    measured, predicted = _measured(traces), _predicted(traces)
    for r, (name, unit, factor, least) in enumerate(CHANNELS):
        y, model = factor * measured[r], factor * predicted[r][k, winner]
        panel = figure.panel(left, 30.0 + r * (row + SPACE), width, row, span, padded(y, least=least))
        panel.frame("", f"{name} [{unit}]", x_ticks=False)
        for event in events:
            if event.label != NOMINAL and event.onset_s is not None:
                panel.band(event.onset_s, event.end_s, colour_of(event.label, event.channel), 0.10)
        panel.line(traces.t, y, MEASURED, 1.0, opacity=0.8)
        for j in np.unique(winner):
            panel.line(traces.t, np.where(winner == j, model, np.nan), colour_of(modes[j]), 0.9)
        if r == 3:
            panel.line(traces.t, traces.w_cmd, MUTED, 1.0, "3 3")
            panel.end_labels([(_last(traces.w_cmd), "command", MUTED)])
        _events(panel, verdict, words=r == 0)
    panel = figure.panel(left, 30.0 + 4 * (row + SPACE), width, row, span, (-0.03, 1.03))
    panel.frame("time [s]", "probability")
    _probabilities(panel, traces.t, traces.probability, modes)
    return figure.svg()


def consistency(traces: Traces) -> str:
    """Normalised innovations of the winner, by channel."""
    row = 72.0
    figure = _sheet("consistency", 3, "Normalised innovations of the winning observer", row=row, top=30.0)
    left, width = _columns(1)[0]
    for r, name in enumerate(("Voltage", "Current", "Position")):
        panel = figure.panel(left, 30.0 + r * (row + SPACE), width, row, _span(traces.t), (-6.0, 6.0))
        panel.frame("time [s]" if r == 2 else "", f"{name} [standard deviations]", x_ticks=r == 2)
        every = slice(None, None, max(1, traces.t.size // DOTS))
        y = np.clip(traces.normalised[every, r], -5.8, 5.8)
        low, high = (float(panel.at_y(np.array(v))) for v in (-1.96, 1.96))
        panel.parts.insert(
            0,
            f'<rect x="{left:.1f}" y="{high:.1f}" width="{width:.1f}" '
            f'height="{low - high:.1f}" fill="#eef0f3"/>',
        )
        panel.points(traces.t[every], y, MEASURED, 1.8, 0.5)
    return figure.svg()


def _sheet(name: str, rows: int, title: str, row: float = ROW, top: float = TOP) -> Figure:
    return Figure(name, WIDTH, top + rows * row + (rows - 1) * SPACE + 42.0, title)


def _columns(count: int) -> list[tuple[float, float]]:
    """(left, width) of the panels side by side; names of lines stand right of each."""
    room = WIDTH - LEFT - RIGHT
    if count == 1:
        return [(LEFT, room)]
    width = (room - GAP) / 2.0
    return [(LEFT, width), (LEFT + width + GAP, width)]


def _heads(figure: Figure, boxes: list[tuple[float, float]], heads: tuple[str, str]) -> None:
    for (left, _), head in zip(boxes, heads, strict=False):
        figure.text(left, 22.0, head, INK, 650, 14)


def _events(panel: Panel, verdict: Event, words: bool = False) -> None:
    """Onset with its interval, and the moment from which the verdict is certain."""
    if verdict.label == NOMINAL:
        return
    low, high = verdict.onset_interval_s
    if low is not None and high is not None and verdict.onset_s is not None:
        panel.band(low, high, ONSET, 0.45)
        panel.moment(verdict.onset_s, "onset" if words else "", "#8a6100", side="end")
    if verdict.isolated_s is not None:
        panel.moment(verdict.isolated_s, "isolated" if words else "", INK, "2 2")


def _measured(traces: Traces) -> list[Array]:
    return [traces.z[:, 0], traces.z[:, 1], traces.z[:, 2], traces.w]


def _predicted(traces: Traces) -> list[Array]:
    return [*(traces.predicted[:, :, c] for c in range(3)), traces.w_predicted]


def _limits(measured: Array, predicted: Array, least: float) -> tuple[float, float]:
    """The range of the data, and of the predictions as far as they leave it by half its height."""
    low, high = padded(measured, least=least)
    room = 0.5 * (high - low)
    finite = predicted[np.isfinite(predicted)]
    if not finite.size:
        return low, high
    return min(low, max(float(finite.min()), low - room)), max(high, min(float(finite.max()), high + room))


def _decades(norm: Array) -> tuple[float, float]:
    good = norm[np.isfinite(norm) & (norm > 0.0)]
    if not good.size:
        return 0.1, 10.0
    low, high = float(np.quantile(good, 0.02)), float(good.max())
    return max(low, 1e-3 * high) / 1.2, high * 1.3


def _running_rms(y: Array, window: int) -> Array:
    kernel = np.ones(min(window, y.size))
    good = np.isfinite(y)
    total = np.convolve(np.where(good, y, 0.0) ** 2, kernel, "same")
    count = np.convolve(good.astype(float), kernel, "same")
    return np.sqrt(np.divide(total, count, out=np.full(y.size, np.nan), where=count > 0))


def _span(t: Array) -> tuple[float, float]:
    return float(t[0]), float(t[-1])


def _last(y: Array) -> float:
    good = y[np.isfinite(y)]
    return float(good[-1]) if good.size else float("nan")
