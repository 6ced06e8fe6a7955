"""Charts of a page: what is packed comes back, what is thinned keeps its extremes, and nothing breaks out of the page."""

import importlib.metadata
import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packed import unpacked

from observer_fi.errors import UsageError
from observer_fi.report import interactive
from observer_fi.report.diagnosis import environment
from observer_fi.report.interactive import Charts, Mark, Panel, Series, joined, on_black, thinned

PAGE = '{% import "charts.html" as parts %}{{ parts.style(uplot()) }}{{ parts.charts(group) }}{{ parts.script(uplot()) }}'


def charts(*series: Series, limits: tuple[float, float] | None = None, name: str = "a") -> Charts:
    x = np.linspace(0.0, 1.0, series[0].y.size)
    return Charts(name, (Panel("Current", "mA", x, series, "What is shown.", limits=limits),))


def line(y: np.ndarray, **other: object) -> Series:
    return Series("measured", y, "#0072b2", **other)  # type: ignore[arg-type]


@given(
    st.integers(1, 900), st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.booleans(), st.integers(0, 2**32 - 1)
)
def test_what_is_packed_comes_back(n: int, middle: float, wide: float, two: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    y = middle + wide * rng.uniform(-1.0, 1.0, n)
    y[rng.random(n) < 0.1] = np.nan
    told = json.loads(charts(line(y, two_bytes=two), limits=(middle - wide, middle + wide)).json)
    found = unpacked(told["panels"][0]["series"][0]["y"])
    np.testing.assert_array_equal(np.isnan(found), np.isnan(y))
    step = 2.0 * wide / 65534.0 if two else 0.0
    np.testing.assert_allclose(found, y, rtol=1e-5, atol=step + 1e-6 * abs(middle))
    np.testing.assert_allclose(unpacked(told["x"][0]), np.linspace(0.0, 1.0, n), rtol=1e-11)


def test_times_of_long_logs_keep_their_microseconds() -> None:
    x = 1.7e9 + np.arange(1000) / 1600.0
    panel = Panel("a", "", x, (line(x),), "What is shown.")
    np.testing.assert_array_equal(unpacked(json.loads(Charts("a", (panel,)).json)["x"][0]), x)


def test_one_axis_of_several_panels_is_packed_once() -> None:
    x = np.arange(500.0)
    panels = tuple(Panel(f"p{k}", "", x, (line(x),), "What is shown.") for k in range(4))
    assert len(json.loads(Charts("a", panels).json)["x"]) == 1


@pytest.mark.parametrize("spikes", [[5_300], [70_300, 12], []])
def test_thinning_keeps_extremes_gaps_and_little_else(spikes: list[int]) -> None:
    x = np.arange(100_000.0)
    y, z = np.sin(x / 900.0), np.cos(x / 500.0)
    y[spikes] = 9.0
    y[30_000:40_000] = np.nan
    kept, (a, b) = thinned(x, y, z, most=2000)
    assert kept.size < 2200 and (np.diff(kept) > 0.0).all()
    assert np.nanmax(a) == np.nanmax(y) and np.nanmin(a) == np.nanmin(y) and b.min() == z.min()
    np.testing.assert_array_equal(a, y[kept.astype(int)])
    assert np.isnan(a[(kept >= 30_000) & (kept < 40_000)]).all() and np.isnan(a).any()
    assert thinned(x[:50], y[:50])[0].size == 50


def test_curves_over_axes_of_their_own_share_one() -> None:
    x, (a, b) = joined(
        (np.array([0.0, 2.0]), np.array([1.0, 2.0])), (np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    )
    np.testing.assert_array_equal(x, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(a, [1.0, np.nan, 2.0])
    np.testing.assert_array_equal(b, [np.nan, 3.0, 4.0])


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize(
    "colour", ["#0072b2", "#d55e00", "#1b1f24", "#6b7280", "#8a6100", "#3d444c", "#a6761d", "#b4560f"]
)
def test_colours_can_be_seen_on_black(colour: str) -> None:
    """WCAG asks for a contrast of 3 between a graphic and what lies behind it."""
    assert (luminance(on_black(colour)) + 0.05) / (luminance("#14181c") + 0.05) > 3.0


def test_nothing_breaks_out_of_the_page() -> None:
    evil = "</script><script>alert(1)</script><!-- \u2028 & \"'"
    mark = Mark(0.5, evil, "#000000")
    panel = Panel(evil, evil, np.arange(3.0), (Series(evil, np.arange(3.0), "#000000"),), evil, marks=(mark,))
    group = Charts("a", (panel,))
    html = environment().from_string(PAGE).render(group=group)
    assert "alert(1)</script>" not in html and "<!--" not in html
    assert html.count("<script") == html.count("</script>") == 3
    assert json.loads(group.json)["panels"][0]["series"][0]["name"] == evil


def test_the_library_is_found_without_importing_what_it_comes_with() -> None:
    code = (
        "import sys; from observer_fi.report.interactive import library; found = library()\n"
        "assert 'uPlot' in found['script'] and '.u-over' in found['style'] and '</' not in found['script']\n"
        "assert not {'uplot', 'IPython', 'matplotlib'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_without_the_library_there_is_one_line_that_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> object:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(interactive, "distribution", missing)
    interactive.library.cache_clear()
    with pytest.raises(UsageError, match="pip install uplot-python"):
        interactive.library()
    interactive.library.cache_clear()
