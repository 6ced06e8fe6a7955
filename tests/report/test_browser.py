"""Every kind of page in a browser, offline: no errors, zoom, legend, dark, phone, and what axe-core finds."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from force_rig import DRAG, Truth, log, rig
from made_plan import plan
from trend_logs import cycle_frame

from observer_fi.cli import main
from observer_fi.improve.improvement import improve
from observer_fi.learn.section3 import Step
from observer_fi.physics.rigs import load_rig
from observer_fi.physics.scenario import Fault, Move, Scenario, synthesise
from observer_fi.records import Fit, Parameter
from observer_fi.report import diagnosis, plan_page
from observer_fi.report.learning import identify_files, improve_files
from observer_fi.settings import Settings
from observer_fi.verdict.diagnosis import diagnose_log

playwright = pytest.importorskip(
    "playwright.sync_api", reason="pages are tried in a browser that playwright drives"
)
axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-core looks for barriers")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to open the pages in")
SLOW = [
    pytest.param(kind, marks=pytest.mark.slow)
    for kind in ("healthy", "improve", "compare", "trend", "fleet", "plan")
]
KINDS = ["fault", "identify", *SLOW]
DARK = pytest.param("dark", marks=pytest.mark.slow)
RIG = load_rig()
WIDE, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


def diagnosed(kind: str) -> str:
    made, _ = synthesise(
        Scenario((Move(0.2, 410.0, 1.4),), 1.9, fault=Fault(kind, 0.9), seed=8), RIG, f"{kind}.csv"
    )
    return diagnosis.files(diagnose_log(made, RIG, Settings()), RIG)["report.html"]


def identified() -> str:
    """A page with all that identify can show, of a fit that was made up."""
    t, rng = np.arange(9000) / 1600.0, np.random.default_rng(1)
    y = np.column_stack([np.sin(t), 0.02 * np.cos(3.0 * t), 1e-3 * t])
    fits = [
        {
            "time": t,
            "measured": y + 1e-3 * rng.normal(size=y.shape),
            "simulated": y,
            "residual": rng.normal(size=y.shape),
        }
    ]
    x = np.linspace(0.01, 0.1, 30)
    step = Step("1", {"A": 1e-3}, {"A": 1e-5}, {"current": x, "torque": 2.0 * x, "fitted": 2.1 * x})
    two = tuple(Parameter(name, 1.0, 0.1, 1.1, "N m", 0.8, 1.2) for name in ("A", "B"))
    fit = Fit(two, np.array([[1.0, -0.9], [-0.9, 1.0]]), {"C": "no move uphill"}, 1.2, {"current_a": 1e-3},
              {"fits": fits, "steps": {"friction": step}})  # fmt: skip
    return identify_files(fit, RIG, RIG, {"steady": np.ones(3)}, "made_up", ["made_up.csv"])["identify.html"]


def improved() -> str:
    return improve_files(improve([log(Truth(DRAG, DRAG))], rig()), None, "bench", ["bench.csv"])[
        "improve.html"
    ]


def compared(folder: Path) -> str:
    assert main(["compare", "--cases", "3", "--out", str(folder), "--quiet"]) == 0
    return (folder / "compare" / "compare.html").read_text(encoding="utf-8")


def trended(folder: Path) -> str:
    for k in range(12):
        cycle_frame(seed=k, friction=0.9 if k < 9 else 1.1).to_csv(folder / f"cycle{k:02d}.csv", index=False)
    logs = [str(p) for p in sorted(folder.glob("cycle*.csv"))]
    assert main(["trend", *logs, "--name", "t", "--out", str(folder), "--workers", "1", "--quiet"]) == 0
    return (folder / "t" / "trend.html").read_text(encoding="utf-8")


def fleet(folder: Path) -> str:
    (folder / "logs").mkdir()
    for kind in ("none", "overload"):
        made, _ = synthesise(
            Scenario((Move(0.2, 410.0, 0.8),), 1.3, fault=Fault(kind, 0.6), seed=3), RIG, kind
        )
        table = {
            "time_s": made.t,
            "voltage_v": made.z[:, 0],
            "current_a": made.z[:, 1],
            "position_m": made.z[:, 2],
        }
        frame = pd.DataFrame(table | {"speed_cmd_rad_s": made.w_cmd, "pitch_deg": made.pitch})
        frame.to_csv(folder / "logs" / f"{kind}.csv", index=False)
    (folder / "logs" / "bad.csv").write_text("nothing", encoding="utf-8")
    main(["fleet", str(folder / "logs"), "--out", str(folder), "--workers", "1", "--quiet"])
    return (folder / "index.html").read_text(encoding="utf-8")


MADE = {
    "fault": lambda folder: diagnosed("overload"),
    "healthy": lambda folder: diagnosed("none"),
    "identify": lambda folder: identified(),
    "improve": lambda folder: improved(),
    "compare": compared,
    "plan": lambda folder: plan_page.page(plan(pitches=(0.0, 10.0))),
    "trend": trended,
    "fleet": fleet,
}


class Pages(dict[str, Path]):
    """A page of each kind, made when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    def __missing__(self, kind: str) -> Path:
        self[kind] = self.folder / f"{kind}.html"
        self[kind].write_text(MADE[kind](self.folder), encoding="utf-8")
        return self[kind]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Pages:
    return Pages(tmp_path_factory.mktemp("pages"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def opened(browser: Any, pages: Pages) -> Iterator[Any]:
    """Opens a page of a kind: `page, errors = opened("fault")`."""
    contexts = []

    def go(kind: str, viewport: dict[str, int] = WIDE, scheme: str = "light") -> tuple[Any, list[str]]:
        context = browser.new_context(viewport=viewport, color_scheme=scheme, offline=True)
        contexts.append(context)
        page, errors = context.new_page(), []
        page.on(
            "console", lambda said: errors.append(said.text) if said.type in ("error", "warning") else None
        )
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on(
            "request", lambda asked: errors.append(asked.url) if not asked.url.startswith("file:") else None
        )
        page.goto(pages[kind].as_uri())
        page.evaluate("document.querySelectorAll('details').forEach(d => { d.open = true; })")
        page.wait_for_function("window.observerFiCharts.charts.every(c => c.u)")
        settled(page)
        return page, errors

    yield go
    for context in contexts:
        context.close()


def settled(page: Any) -> None:
    """What is asked of the next frame has been drawn."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def bounds(page: Any, link: str = "time") -> np.ndarray:
    """Range of x of every chart of a link, (charts, 2)."""
    seen = f"window.observerFiCharts.charts.filter(c => c.spec.link === '{link}').map(c => [c.u.scales.x.min, c.u.scales.x.max])"
    return np.array(page.evaluate(seen))


def drag(page: Any, chart: int, begin: float, end: float) -> None:
    """Drag across a chart between two shares of its width."""
    over = page.locator(".u-over").nth(chart)
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    y = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + begin * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + end * box["width"], y, steps=4)
    page.mouse.up()
    settled(page)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.first(2)
def test_a_page_opens_without_errors_and_without_a_network(opened: Any, kind: str) -> None:
    page, errors = opened(kind)
    assert errors == []
    painted = page.evaluate(
        """window.observerFiCharts.charts.map(c => {
             const data = c.u.ctx.getImageData(...c.box()).data;
             let seen = 0;
             for (let k = 3; k < data.length; k += 4) seen += data[k] > 0;
             return seen; })"""
    )
    assert painted and min(painted) > 200  # nothing is empty


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scheme", ["dark", pytest.param("light", marks=pytest.mark.slow)])
def test_a_phone_shows_it_without_overflow_in_letters_that_can_be_read(
    opened: Any, kind: str, scheme: str
) -> None:
    page, errors = opened(kind, PHONE, scheme)
    assert errors == []
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    smallest = page.evaluate(
        """Math.min(...[...document.querySelectorAll('main *')].filter(e =>
             [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()) && e.getClientRects().length &&
             !['SCRIPT', 'STYLE', 'NOSCRIPT', 'OPTION'].includes(e.tagName))
             .map(e => parseFloat(getComputedStyle(e).fontSize)))"""
    )
    drawn = page.evaluate(
        "window.observerFiCharts.charts.flatMap(c => c.u.axes.map(a => parseFloat(a.font[0] || a.font)))"
    )
    ratio = page.evaluate("devicePixelRatio")
    assert smallest >= 11.0 and min(drawn, default=99.0) / ratio >= 11.0
    light = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert light == (scheme == "light")


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scheme", ["light", DARK])
def test_axe_finds_nothing_serious(opened: Any, kind: str, scheme: str) -> None:
    page, _ = opened(kind, WIDE, scheme)
    found = axe.Axe().run(page).response["violations"]
    serious = [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")]
    assert serious == []


def test_a_fault_is_shown_from_before_its_onset_to_past_its_isolation(opened: Any) -> None:
    page, _ = opened("fault")
    low, high = bounds(page)[0]
    assert low < 0.9 < high < 1.4 and (bounds(page) == [low, high]).all()
    page.get_by_role("button", name="whole log").click()
    settled(page)
    assert bounds(page)[0] == pytest.approx([0.0, 1.9], abs=1e-3)


def test_dragging_zooms_every_linked_chart_to_single_samples(opened: Any) -> None:
    page, _ = opened("fault")
    low, high = bounds(page)[0]
    drag(page, 1, 0.25, 0.5)
    found = bounds(page)
    assert len(found) >= 9 and (found == found[0]).all()
    assert found[0] == pytest.approx(
        [low + 0.25 * (high - low), low + 0.5 * (high - low)], abs=0.01 * (high - low)
    )
    inside = page.evaluate(
        "(c => c.x.filter(t => t >= c.axis.now[0] && t <= c.axis.now[1]))(window.observerFiCharts.charts[0])"
    )
    assert len(inside) > 20 and np.diff(inside).max() < 1.01 / 1600.0
    page.locator(".u-over").nth(1).dblclick()
    settled(page)
    assert bounds(page)[0] == pytest.approx([0.0, 1.9], abs=1e-3)


def test_keys_and_wheel_move_and_zoom(opened: Any) -> None:
    page, _ = opened("fault")
    before = bounds(page)[0]
    wide = before[1] - before[0]
    page.locator(".plot").first.focus()
    for key, shift, factor in (
        ("ArrowRight", 0.2, 1.0),
        ("ArrowLeft", 0.0, 1.0),
        ("+", 0.25, 0.5),
        ("-", 0.0, 1.0),
    ):
        page.keyboard.press(key)
        settled(page)
        assert bounds(page)[0] == pytest.approx(
            [before[0] + shift * wide, before[0] + (shift + factor) * wide], abs=1e-9
        )
    page.locator(".u-over").first.hover()
    page.mouse.wheel(0, -100)
    settled(page)
    zoomed = bounds(page)[0]
    assert before[0] < zoomed[0] < zoomed[1] < before[1]
    page.keyboard.press("Escape")
    settled(page)
    assert bounds(page)[0] == pytest.approx([0.0, 1.9], abs=1e-3)


def test_fingers_pinch(opened: Any) -> None:
    page, _ = opened("fault", PHONE)
    before = bounds(page)[0]
    page.evaluate(
        """() => { const over = document.querySelector('.u-over'), box = over.getBoundingClientRect();
          over.setPointerCapture = () => {};
          const touch = (type, id, share) => over.dispatchEvent(new PointerEvent(type, { pointerId: id, pointerType: 'touch',
            clientX: box.left + share * box.width, clientY: box.top + 9, bubbles: true }));
          touch('pointerdown', 1, 0.4); touch('pointerdown', 2, 0.6);
          touch('pointermove', 1, 0.3); touch('pointermove', 2, 0.7);
          touch('pointerup', 1, 0.3); touch('pointerup', 2, 0.7); }"""
    )
    settled(page)
    after = bounds(page)[0]
    assert (after[1] - after[0]) == pytest.approx(0.5 * (before[1] - before[0]), rel=0.01)


def test_a_line_hides_by_its_name_and_shows_its_value_with_a_unit(opened: Any) -> None:
    page, _ = opened("fault")
    current = page.locator(".panel").nth(1)
    button = current.get_by_role("button", name="measured")
    assert button.get_attribute("aria-pressed") == "true"
    current.locator(".u-over").hover()
    settled(page)
    assert "mA" in button.inner_text()
    button.focus()
    page.keyboard.press("Enter")
    assert button.get_attribute("aria-pressed") == "false"
    assert page.evaluate("window.observerFiCharts.charts[1].u.series[1].show") is False


def at_dot(page: Any, chart: int, k: int) -> None:
    """Put the cursor on the k-th dot of a chart."""
    over = page.locator(".u-over").nth(chart)
    over.scroll_into_view_if_needed()
    at = page.evaluate(f"(c => c.u.valToPos(c.x[{k}], 'x'))(window.observerFiCharts.charts[{chart}])")
    over.hover(position={"x": at, "y": 20})
    settled(page)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "name"), [("fleet", "none.csv"), ("trend", "cycle02.csv")])
def test_a_dot_tells_the_log_that_it_is_of(opened: Any, kind: str, name: str) -> None:
    page, errors = opened(kind)
    at_dot(page, 0, 1 if kind == "fleet" else 2)
    assert page.locator(".who").first.inner_text() == name and errors == []


@pytest.mark.slow
def test_a_fleet_leads_to_its_logs_and_back(opened: Any) -> None:
    page, errors = opened("fleet")
    at_dot(page, 0, 2)  # bad, none, overload
    page.mouse.down()
    page.mouse.up()
    page.wait_for_url("**/overload/report.html")
    page.get_by_role("link", name="All logs").click()
    page.wait_for_url("**/index.html")
    assert errors == []


@pytest.mark.slow
def test_a_fleet_says_what_each_log_asks_for_where_it_is_seen(opened: Any) -> None:
    page, _ = opened("fleet")
    rows = page.locator("#fleet tbody tr")
    assert rows.first.locator("td").first.inner_text() == "overload.csv"
    assert "no samples" in page.locator("tr[data-what=bad] td.what").inner_text()
    seen = page.locator("td.what").evaluate_all("cells => cells.map(c => c.getBoundingClientRect().right)")
    assert max(seen) < WIDE["width"]
    page.get_by_role("button", name="log", exact=True).click()
    names = rows.evaluate_all("rows => rows.map(r => r.cells[0].innerText)")
    assert names == ["bad.csv", "none.csv", "overload.csv"]
    needs = page.evaluate(
        "window.observerFiCharts.charts[0].u.data.slice(1).map(y => y.findIndex(v => v !== null))"
    )
    assert needs == [2, 0, 1]  # act: overload, no verdict: bad, healthy: none


def test_dark_and_light_change_what_is_drawn(opened: Any) -> None:
    page, _ = opened("fault")
    stroke = "window.observerFiCharts.charts[0].u.series[1].stroke()"
    light = page.evaluate(stroke)
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(stroke) != light
    page.emulate_media(color_scheme="dark", media="print")
    settled(page)
    assert page.evaluate(stroke) == light  # paper is white


def test_without_scripts_the_page_says_so(browser: Any, pages: Pages) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(pages["fault"].as_uri())
    assert "drawn by a script within this page" in page.locator(".charts").first.inner_text()
    context.close()
