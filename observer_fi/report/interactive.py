"""Charts that a reader can zoom, for pages that work offline: panels of named series to HTML, one JSON block, one script.

The drawing is uPlot's (docs/decisions/0019), which comes with the package uplot-python; `templates/charts.js` links time
axes, zooms, hides and prints. Nothing here knows what a log is. The same panels give the same bytes.
"""

import base64
import colorsys
import json
import math
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from observer_fi.errors import UsageError
from observer_fi.records import Array

INK, MUTED = "#1b1f24", "#5c6670"
TIME = "time"  # panels of this link share their axis, all over a page
_DIGITS = 6  # of a value as text, where text is shorter than four bytes
_STEPS = 65534  # of a series that is packed into two bytes a value; one more says that nothing is known
_LIGHT = 0.68  # lightness of a colour on black, at least


@dataclass(frozen=True)
class Series:
    """One line, y (n,) in the panel's unit, NaN where there is nothing; colour on white (that on black follows).

    low, high (n,): a band around it. points: dots of this size, 0 for none. shown: whether the legend starts with it on.
    spans: whether the line goes on where points are missing, as it must over an axis that is not its own. two_bytes: whether
    its panel's limits hold all of it, so that 1/65534 of their distance is fine enough.
    """

    name: str
    y: Array
    colour: str
    width: float = 1.5
    dash: tuple[int, ...] = ()
    points: float = 0.0
    low: Array | None = None
    high: Array | None = None
    shown: bool = True
    spans: bool = False
    two_bytes: bool = False


class Level(NamedTuple):
    """A horizontal line at y, or a band up to `to`, with a name or none."""

    y: float
    name: str = ""
    to: float | None = None


class Mark(NamedTuple):
    """A moment with a name: a vertical line, or a band from low to high with a line in it where `at` is a number."""

    at: float
    name: str
    colour: str
    low: float | None = None
    high: float | None = None


class View(NamedTuple):
    """A part of the axis that a button leads to."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Panel:
    """One set of axes over x (n,), ascending. about: what it shows, a sentence for who cannot see it.

    least: the narrowest range of y that is shown; limits: a fixed one. link: panels of one name share the range of x.
    ticks, ticks_up: names of places on the x and y axis instead of numbers. names: what the points of each x are of, shown
    under the cursor; links: where a click on them leads.
    """

    title: str
    unit: str
    x: Array
    series: tuple[Series, ...]
    about: str
    x_name: str = "time [s]"
    link: str = ""
    limits: tuple[float, float] | None = None
    least: float = 0.0
    scale: str = "linear"  # or "log", or "asinh": linear within one, logarithmic beyond
    levels: tuple[Level, ...] = ()
    marks: tuple[Mark, ...] = ()
    height: int = 130
    ticks: tuple[tuple[float, str], ...] = ()
    ticks_up: tuple[tuple[float, str], ...] = ()
    names: tuple[str, ...] = ()
    links: tuple[str, ...] = ()


@dataclass(frozen=True)
class Charts:
    """Panels below each other (or in columns, as `small`), with buttons for parts of their axis.

    name keeps the groups of a page apart. start: the view that is shown first, None for all of it.
    """

    name: str
    panels: tuple[Panel, ...]
    marks: tuple[Mark, ...] = ()
    views: tuple[View, ...] = ()
    start: int | None = None
    small: bool = False
    colours: dict[str, int] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        """Number the colours, which the page defines for white and for black."""
        used = [s.colour for p in self.panels for s in p.series]
        used += [m.colour for m in (*self.marks, *(m for p in self.panels for m in p.marks))]
        self.colours.update({colour: k for k, colour in enumerate(dict.fromkeys(used))})

    @property
    def css(self) -> list[tuple[int, str, str]]:
        """Number, colour on white and colour on black of everything that is drawn."""
        return [(k, colour, on_black(colour)) for colour, k in self.colours.items()]

    @property
    def json(self) -> str:
        """What `charts.js` draws, as text that may stand within a script element."""
        xs: dict[int, int] = {}
        arrays: list[Any] = []
        for panel in self.panels:
            if id(panel.x) not in xs:
                xs[id(panel.x)] = len(arrays)
                arrays.append(_packed(panel.x, "<f8"))
        points: dict[tuple[tuple[str, ...], ...], int] = {}  # panels of the same logs tell their names once
        told = {
            "x": arrays,
            "panels": [
                self._panel(panel, xs[id(panel.x)])
                | {"points": points.setdefault((panel.names, panel.links), len(points))}
                for panel in self.panels
            ],
            "points": [{"names": names, "links": links} for names, links in points],
            "marks": [self._mark(mark) for mark in self.marks],
            "views": [view._asdict() for view in self.views],
            "start": self.start,
        }
        text = json.dumps(told, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")

    def _panel(self, panel: Panel, x: int) -> dict[str, Any]:
        return {
            "x": x, "link": panel.link, "unit": panel.unit, "xName": panel.x_name, "limits": panel.limits,
            "least": panel.least, "scale": panel.scale, "height": panel.height, "ticks": panel.ticks,
            "ticksUp": panel.ticks_up,
            "levels": [level._asdict() for level in panel.levels],
            "marks": [self._mark(mark) for mark in panel.marks],
            "series": [self._series(series, panel) for series in panel.series],
        }  # fmt: skip

    def _series(self, series: Series, panel: Panel) -> dict[str, Any]:
        limits = panel.limits if series.two_bytes else None
        band = {
            side: _packed(y, "<f4") for side in ("low", "high") if (y := getattr(series, side)) is not None
        }
        return {
            "name": series.name, "y": _packed(series.y, "<f4", limits), "colour": self.colours[series.colour],
            "width": series.width, "dash": series.dash, "points": series.points, "shown": series.shown,
            "spans": series.spans, **band,
        }  # fmt: skip

    def _mark(self, mark: Mark) -> dict[str, Any]:
        return {**mark._asdict(), "colour": self.colours[mark.colour]}


def joined(*curves: tuple[Array, Array]) -> tuple[Array, list[Array]]:
    """Curves over abscissas of their own, (x, y) each, over one that holds all; NaN where a curve has no point."""
    everywhere = np.unique(np.concatenate([x[np.isfinite(x)] for x, _ in curves]))
    found = []
    for x, y in curves:
        out = np.full(everywhere.size, np.nan)
        known = np.isfinite(x)
        out[np.searchsorted(everywhere, x[known])] = y[known]
        found.append(out)
    return everywhere, found


def thinned(x: Array, *columns: Array, most: int = 6000) -> tuple[Array, list[Array]]:
    """The samples that show at this many points: of each bin the first, and the extremes of every column."""
    bins = max(1, most // (1 + 2 * len(columns)))
    if x.size <= most:
        return x, list(columns)
    number = np.arange(x.size) * bins // x.size
    first = np.searchsorted(number, np.arange(bins))
    keep = [first]
    for y in columns:
        for filled in (np.nan_to_num(y, nan=np.inf), np.nan_to_num(-y, nan=np.inf)):
            keep.append(np.lexsort((filled, number))[first])
        gaps = ~np.isfinite(y)
        keep.append(np.flatnonzero(gaps & ~np.concatenate(([False], gaps[:-1]))))
    kept = np.unique(np.concatenate(keep))
    return x[kept], [y[kept] for y in columns]


def on_black(colour: str) -> str:
    """The colour that reads on black as this one does on white: as it is where it is light, else lighter."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    hue, light, full = colorsys.rgb_to_hls(red, green, blue)
    shown = max(light, _LIGHT) if full > 0.2 else max(1.0 - light, _LIGHT)
    return "#" + "".join(f"{round(255.0 * v):02x}" for v in colorsys.hls_to_rgb(hue, shown, full))


@cache
def library() -> dict[str, str]:
    """Script and style sheet of uPlot, as text. Raises UsageError where the package is missing."""
    try:
        package = distribution("uplot-python")
    except PackageNotFoundError:
        raise UsageError("pages are drawn by uPlot, which is missing: pip install uplot-python") from None
    folder = Path(str(package.locate_file("uplot/static")))
    try:
        script = (folder / "uPlot.iife.js").read_text(encoding="utf-8")
        style = (folder / "uPlot.min.css").read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"pages are drawn by uPlot, which cannot be read: {error}") from None
    return {"script": script.replace("</", "<\\/"), "style": style}


def _packed(y: Array, kind: str, limits: tuple[float, float] | None = None) -> Any:
    """An array as little-endian bytes in base64, or as numbers where that is shorter."""
    y = np.asarray(y, dtype=np.float64)
    digits = 12 if kind == "<f8" else _DIGITS
    text = [float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in y[:200].tolist()]
    if y.size <= 200 and len(json.dumps(text, separators=(",", ":"))) < 6 * y.size:
        return text
    if limits is None:
        return {"kind": kind[1:], "data": base64.b64encode(y.astype(kind).tobytes()).decode("ascii")}
    low, high = limits
    steps = np.rint((np.clip(y, low, high) - low) / (high - low) * _STEPS)
    whole = np.where(np.isfinite(y), steps, _STEPS + 1).astype("<u2")
    return {
        "kind": "u2",
        "low": low,
        "high": high,
        "data": base64.b64encode(whole.tobytes()).decode("ascii"),
    }
