"""Line charts as SVG text: the same data give the same bytes, a figure costs milliseconds, and a page needs
no library.

A Figure holds Panels; a Panel maps data to pixels and draws lines, points, bands and labels. Nothing here
knows what a log is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import NDArray

from observer_fi.records import Array

INK, MUTED, GRID = "#1b1f24", "#5c6670", "#e3e6ea"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
_TICK_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LABEL_HEIGHT = 14.0


@dataclass
class Panel:
    """One set of axes: pixel box, data ranges, and whether y is logarithmic."""

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    log: bool = False
    name: str = "p"
    parts: list[str] = field(default_factory=list)  # clipped to the box
    notes: list[str] = field(default_factory=list)  # outside of it

    def at_x(self, x: Array) -> Array:
        """Pixels of data x."""
        return self.left + (np.asarray(x, dtype=float) - self.x[0]) / (self.x[1] - self.x[0]) * self.width

    def at_y(self, y: Array) -> Array:
        """Pixels of data y; what a logarithmic axis cannot show is NaN."""
        low, high, y = *self.y, np.asarray(y, dtype=float)
        if self.log:
            y = np.log10(np.where(y > 0.0, y, np.nan))
            low, high = math.log10(low), math.log10(high)
        return self.top + self.height - (y - low) / (high - low) * self.height

    def frame(self, x_label: str = "", y_label: str = "", x_ticks: bool = True) -> "Panel":
        """Grid, tick labels, a name above the box and a label below it."""
        for tick, text in ticks(*self.y, log=self.log, most=max(3, int(self.height / 28))):
            py = float(self.at_y(np.array(tick)))
            self.parts.append(_line(self.left, py, self.left + self.width, py, GRID, 1.0))
            self.notes.append(_text(self.left - 6, py + 4, text, MUTED, "end"))
        for tick, text in ticks(*self.x, most=max(3, int(self.width / 75))):
            px = float(self.at_x(np.array(tick)))
            self.parts.append(_line(px, self.top, px, self.top + self.height, GRID, 1.0))
            if x_ticks:
                self.notes.append(_text(px, self.top + self.height + 16, text, MUTED, "middle"))
        if y_label:
            self.notes.append(_text(self.left, self.top - 7, y_label, INK, "start", 600))
        if x_label:
            place = self.left + self.width
            self.notes.append(_text(place, self.top + self.height + 32, x_label, MUTED, "end"))
        return self

    def line(
        self, x: Array, y: Array, colour: str, width: float = 1.3, dash: str = "", opacity: float = 1.0
    ) -> None:
        """A line, broken where y is NaN; many points in one pixel column become their extremes."""
        path = path_of(self.at_x(x), self.at_y(y), self.top - 2 * self.height, self.top + 3 * self.height)
        if path:
            style = f' stroke-dasharray="{dash}"' if dash else ""
            style += f' opacity="{opacity:g}"' if opacity < 1.0 else ""
            self.parts.append(
                f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
                f'stroke-linejoin="round"{style}/>'
            )

    def ribbon(self, x: Array, low: Array, high: Array, colour: str, opacity: float = 0.25) -> None:
        """The area between two lines, broken where one is NaN; of a column of a pixel the extremes are kept."""
        px, top, bottom = self.at_x(x), self.at_y(high), self.at_y(low)
        far = (self.top - 2 * self.height, self.top + 3 * self.height)
        good = np.isfinite(px) & np.isfinite(top) & np.isfinite(bottom)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], good.view(np.int8), [0]))))
        path = ""
        for first, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            there = path_of(px[first:stop], top[first:stop], *far)
            back = path_of(px[first:stop][::-1], bottom[first:stop][::-1], *far)
            path += f"{there}L{back[1:]}Z"
        if path:
            self.parts.append(f'<path d="{path}" fill="{colour}" opacity="{opacity:g}"/>')

    def points(self, x: Array, y: Array, colour: str, size: float = 1.8, opacity: float = 1.0) -> None:
        """Dots, as one path."""
        px, py = self.at_x(x), self.at_y(y)
        good = np.isfinite(px) & np.isfinite(py) & (py > self.top - 5) & (py < self.top + self.height + 5)
        path = "".join(f"M{a}h0" for a in _pairs(px[good], py[good]))
        if path:
            self.parts.append(
                f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{size:g}" '
                f'stroke-linecap="round" opacity="{opacity:g}"/>'
            )

    def band(self, x0: float, x1: float, colour: str, opacity: float = 1.0) -> None:
        """A vertical band between two x, at least a pixel and a half wide."""
        a, b = (float(v) for v in np.clip(self.at_x(np.array([x0, x1])), self.left, self.left + self.width))
        if b - a < 1.5:
            a, b = 0.5 * (a + b) - 0.75, 0.5 * (a + b) + 0.75
        self.parts.append(
            f'<rect x="{a:.1f}" y="{self.top:.1f}" width="{b - a:.1f}" height="{self.height:.1f}" '
            f'fill="{colour}" opacity="{opacity:g}"/>'
        )

    def level(self, y: float, colour: str = MUTED, dash: str = "4 3", text: str = "") -> None:
        """A horizontal line, named at its right end."""
        py = float(self.at_y(np.array(y)))
        self.parts.append(_line(self.left, py, self.left + self.width, py, colour, 1.0, dash))
        if text:
            self.parts.append(_text(self.left + 5, py - 4, text, colour, "start", halo=True))

    def moment(
        self, x: float, text: str = "", colour: str = INK, dash: str = "", side: str = "start"
    ) -> None:
        """A vertical line, named at its top."""
        px = float(self.at_x(np.array(x)))
        if not self.left - 0.5 <= px <= self.left + self.width + 0.5:
            return
        self.parts.append(_line(px, self.top, px, self.top + self.height, colour, 1.2, dash))
        if text:
            shift = 4 if side == "start" else -4
            self.parts.append(_text(px + shift, self.top + 13, text, colour, side, halo=True))

    def end_labels(self, labels: Sequence[tuple[float, str, str]]) -> None:
        """Names at the right edge, (data y, text, colour) each, moved apart where they would overlap."""
        placed = sorted(
            (float(np.clip(self.at_y(np.array(y)), self.top + 4, self.top + self.height - 2)), text, colour)
            for y, text, colour in labels
            if math.isfinite(y) and (y > 0.0 or not self.log)
        )
        for py, (_, text, colour) in zip(
            spread([p for p, _, _ in placed], self.top, self.top + self.height), placed, strict=True
        ):
            self.notes.append(_text(self.left + self.width + 6, py + 4, text, colour, "start", 600))

    def note(self, text: str) -> None:
        """Words in the middle of an empty panel."""
        self.notes.append(
            _text(self.left + self.width / 2, self.top + self.height / 2, text, MUTED, "middle")
        )

    def svg(self) -> str:
        """The panel as SVG elements."""
        box = f'x="{self.left:.1f}" y="{self.top:.1f}" width="{self.width:.1f}" height="{self.height:.1f}"'
        return (
            f'<clipPath id="{self.name}"><rect {box}/></clipPath><g clip-path="url(#{self.name})">'
            + "".join(self.parts)
            + f'</g><rect {box} fill="none" stroke="#b8bfc7"/>'
            + "".join(self.notes)
        )


@dataclass
class Figure:
    """A sheet of panels. name keeps the ids of several figures on one page apart."""

    name: str
    width: float
    height: float
    title: str
    panels: list[Panel] = field(default_factory=list)
    extra: list[str] = field(default_factory=list)

    def panel(
        self, left: float, top: float, width: float, height: float,
        x: tuple[float, float], y: tuple[float, float], log: bool = False,
    ) -> Panel:  # fmt: skip
        """A new panel in this pixel box."""
        panel = Panel(left, top, width, height, x, y, log, f"{self.name}-{len(self.panels)}")
        self.panels.append(panel)
        return panel

    def text(
        self, x: float, y: float, text: str, colour: str = INK, weight: int = 400, size: float = 12
    ) -> None:
        """Words on the sheet."""
        self.extra.append(_text(x, y, text, colour, "start", weight, size=size))

    def svg(self) -> str:
        """The figure as one SVG document that also stands alone."""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {self.width:g} {self.height:g}" '
            f'role="img" aria-label="{escape(self.title)}" font-family="{FONT}" font-size="12">'
            f"<title>{escape(self.title)}</title>"
            f'<rect width="{self.width:g}" height="{self.height:g}" fill="#fff"/>'
            + "".join(self.extra)
            + "".join(panel.svg() for panel in self.panels)
            + "</svg>\n"
        )


def ticks(low: float, high: float, log: bool = False, most: int = 5) -> list[tuple[float, str]]:
    """Round values within a range and how to print them, at most about `most`."""
    if log:
        first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
        if last - first < 2:
            fine = [m * 10.0**k for k in range(first - 1, last + 1) for m in (1.0, 2.0, 5.0)]
            return [(v, f"{v:g}") for v in fine if low <= v <= high]
        every = max(1, math.ceil((last - first + 1) / most))
        return [(10.0**k, f"{10.0**k:g}") for k in range(first, last + 1, every)]
    raw = (high - low) / max(most, 1)
    scale = 10.0 ** math.floor(math.log10(raw))
    step = next(s * scale for s in _TICK_STEPS if s * scale >= raw * (1.0 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    digits += abs(round(step * 10**digits) - step * 10**digits) > 1e-6
    first = math.ceil(low / step - 1e-9)
    count = int(math.floor(high / step + 1e-9)) - first + 1
    return [((first + k) * step, f"{(first + k) * step:.{digits}f}".replace("-", "−")) for k in range(count)]


def padded(*series: Array, least: float = 0.0, pad: float = 0.06) -> tuple[float, float]:
    """A range that holds all finite values of the series, with a margin, and is at least `least` wide."""
    values = np.concatenate([np.ravel(s) for s in series]) if series else np.empty(0)
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    extra = max(pad * (high - low), 0.5 * (least - (high - low)), 1e-12)
    return low - extra, high + extra


def spread(places: list[float], low: float, high: float, gap: float = _LABEL_HEIGHT) -> list[float]:
    """Sorted places moved apart to at least `gap`, within low..high where they fit."""
    out = list(places)
    for k in range(1, len(out)):
        out[k] = max(out[k], out[k - 1] + gap)
    over = out[-1] - (high - 2) if out else 0.0
    if over > 0:
        out[-1] -= over
        for k in range(len(out) - 2, -1, -1):
            out[k] = min(out[k], out[k + 1] - gap)
    return [max(p, low) if k == 0 else p for k, p in enumerate(out)]


def path_of(px: Array, py: Array, low: float, high: float) -> str:
    """SVG path through pixels; a column of a pixel keeps its first, least, greatest and last point."""
    keep = _thinned(px, py)
    px, py = px[keep], np.clip(py[keep], low, high)
    good = np.isfinite(px) & np.isfinite(py)
    if not good.any():
        return ""
    starts = good & ~np.concatenate(([False], good[:-1]))
    pieces = []
    for first in np.flatnonzero(starts):
        stop = first + int(np.argmin(good[first:])) if not good[first:].all() else good.size
        pieces.append("M" + "L".join(_pairs(px[first:stop], py[first:stop])))
    return "".join(pieces)


def _thinned(px: Array, py: Array) -> NDArray[np.intp]:
    """Indices of the points that are visible at one column a pixel; all of them where there are few."""
    n = px.size
    if n < 3 or n <= 2.5 * abs(float(px[-1] - px[0])):
        return np.arange(n)
    column = np.floor(px - px[0]).astype(np.int64)
    first = np.flatnonzero(np.concatenate(([True], np.diff(column) != 0)))
    last = np.concatenate((first[1:], [n])) - 1
    gaps = np.flatnonzero(~np.isfinite(py))
    down = np.lexsort((np.nan_to_num(py, nan=np.inf), column))[first]
    up = np.lexsort((np.nan_to_num(-py, nan=np.inf), column))[first]
    return np.unique(np.concatenate((first, last, down, up, gaps)))


def _pairs(px: Array, py: Array) -> list[str]:
    return [f"{a:.1f} {b:.1f}" for a, b in zip(px.tolist(), py.tolist(), strict=True)]


def _line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float, dash: str = "") -> str:
    style = f' stroke-dasharray="{dash}"' if dash else ""
    return (
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{colour}" '
        f'stroke-width="{width:g}"{style}/>'
    )


def _text(
    x: float, y: float, text: str, colour: str, anchor: str, weight: int = 400, halo: bool = False, size:
    float = 0
) -> str:  # fmt: skip
    style = f' font-weight="{weight}"' if weight != 400 else ""
    style += f' font-size="{size:g}"' if size else ""
    style += ' stroke="#fff" stroke-width="3" paint-order="stroke"' if halo else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}"{style}>{escape(text)}</text>'
    )
