"""Figures of `improve` for a force-driven rig: the ladder of causes, the force over time, what the residual follows."""

import numpy as np

from observer_fi.improve import Ladder
from observer_fi.learn import Motion, held_out
from observer_fi.records import Array
from observer_fi.report.chart import MUTED, Figure, padded
from observer_fi.report.learning_figures import AFTER, BEFORE, LEFT, MEASURED, RIGHT, WIDTH

BINS = 40
SHOWN_S = 6.0  # of the first log, from its middle on


def of_ladder(ladder: Ladder) -> dict[str, str]:
    """Every figure of an improve report on a force-driven rig, {name: SVG}."""
    return {"ladder": _steps(ladder), "force": _force(ladder), "curves": _curves(ladder)}


def _steps(ladder: Ladder) -> str:
    """Residual on held-out parts after each step."""
    values = [ladder.rungs[0].before, *(r.after for r in ladder.rungs)] if ladder.rungs else []
    names = ["the rig's own terms", *(" + ".join(c.cause for c in r.candidates) for r in ladder.rungs)]
    figure = Figure("ladder", WIDTH, 26.0 * max(len(values), 1) + 60.0, "Residual after each step")
    top = 1.05 * max(values, default=1.0)
    for k, (name, value) in enumerate(zip(names, values, strict=False)):
        y = 12.0 + 26.0 * k
        figure.text(8.0, y + 14.0, name.replace("_", " "))
        panel = figure.panel(300.0, y, WIDTH - 300.0 - RIGHT, 18.0, (0.0, top), (0.0, 1.0))
        panel.band(0.0, value, BEFORE if k == 0 else AFTER, 0.85)
        panel.end_labels(((0.5, f"{value:.2f} %", MUTED),))
    return figure.svg()


def _rows(motions: tuple[Motion, ...]) -> dict[str, Array]:
    """Speed [m/s], position [m] and time [s] of the samples that solutions hold, log by log."""
    parts = [(m.v[m.kept][m.use], m.x[m.kept][m.use], m.t[m.use]) for m in motions]
    v, x, t = (np.concatenate(column) for column in zip(*parts, strict=True))
    return {"speed": v, "position": x, "time": t}


def _force(ladder: Ladder) -> str:
    """Commanded force of the first log, and what it misses before and after."""
    first = ladder.motions[0]
    n = int(first.use.sum())
    t = first.t[first.use]
    middle = 0.5 * (t[0] + t[-1])
    near = np.flatnonzero((t >= middle) & (t < middle + SHOWN_S))
    figure = Figure("force", WIDTH, 330.0, "Force over time")
    x = padded(t[near])
    start, final = ladder.start, ladder.final
    panel = figure.panel(LEFT, 28.0, WIDTH - LEFT - RIGHT, 120.0, x, padded(start.force[near]))
    panel.frame("", "Commanded force [N]", False)
    panel.line(t[near], start.force[near], MEASURED, 1.6)
    panel.line(t[near], (final.force - final.residual)[:n][near], AFTER, 0.9)
    panel.end_labels(((0.0, "commanded", MUTED), (0.0, "extended rig", AFTER)))
    below = figure.panel(
        LEFT,
        180.0,
        WIDTH - LEFT - RIGHT,
        100.0,
        x,
        padded(np.quantile(start.residual[:n][near], [0.005, 0.995])),
    )
    below.frame("time [s]", "Missed [N]")
    below.level(0.0)
    below.line(t[near], start.residual[:n][near], BEFORE, 0.8)
    below.line(t[near], final.residual[:n][near], AFTER, 0.8)
    below.end_labels(((0.0, "rig's own terms", BEFORE), (0.0, "extended rig", AFTER)))
    return figure.svg()


def _curves(ladder: Ladder) -> str:
    """Mean of the held-out residual over speed and position, before and after."""
    rows = _rows(ladder.motions)
    figure = Figure("curves", WIDTH, 240.0, "What the residual follows")
    for k, (name, scale, label) in enumerate(
        (("speed", 1e3, "speed [mm/s]"), ("position", 1e3, "position [mm]"))
    ):
        at = scale * rows[name]
        curves = [_binned(at, held_out(s)) for s in (ladder.start, ladder.final)]
        panel = figure.panel(
            LEFT + 490.0 * k, 32.0, 390.0, 150.0, padded(curves[0][0]), padded(*(y for _, y in curves))
        )
        panel.frame(label, "Missed, held out, mean [N]" if k == 0 else "")
        panel.level(0.0)
        for (centre, mean), colour in zip(curves, (BEFORE, AFTER), strict=True):
            panel.line(centre, mean, colour, 1.4)
            panel.points(centre, mean, colour, 3.5)
    return figure.svg()


def _binned(at: Array, y: Array) -> tuple[Array, Array]:
    """Centres and means of the bins that hold 20 samples or more."""
    low, high = (float(q) for q in np.quantile(at, [0.002, 0.998]))
    edges = np.linspace(low, high, BINS + 1)
    k = np.digitize(at, edges)
    good = [b for b in range(1, BINS + 1) if (k == b).sum() >= 20]
    return np.array([at[k == b].mean() for b in good]), np.array([y[k == b].mean() for b in good])
