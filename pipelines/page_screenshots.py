"""What pages look like: screenshots for docs/reading.md, 1280 px wide, light, the first screens of each.

    python -m pipelines.page_screenshots [--only overload] [--out docs/figures]

Field logs and recordings are those below OBSERVER_FI_DATA; the browser is a chromium that playwright drives (extra `dev`). Two
runs on one machine give the same pixels.
"""

import argparse
import io
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PIL import Image

from observer_fi import Life, Move, Scenario, diagnose, improve, plan, simulate, write_report
from observer_fi.errors import UsageError
from observer_fi.physics import Fault
from pipelines.trend_cranfield import BASELINE, RATE_RUNS, cycles_of, judged

ROOT = Path(__file__).parents[1]
WIDTH, RATE, LOAD_KG, CYCLES = 1280, 0.01, 20, 60
COLOURS = 96  # of a picture: a third of the bytes, and nothing that an eye misses


def recorded(name: str) -> Path:
    """A file below OBSERVER_FI_DATA."""
    return Path(os.environ.get("OBSERVER_FI_DATA", "")) / name


def life() -> Life:
    """Healthy cycles of the Cranfield rig under one load, and behind them those without lubrication."""
    healthy, dry = (
        [c for c in cycles_of(recorded(f"data/cranfield/{name}.csv.gz")) if c.load == LOAD_KG]
        for name in ("normal", "lack_lubrication1")
    )
    base, others = ([c for c in healthy if c.run in runs] for runs in (BASELINE, RATE_RUNS))
    told = [*others, *dry[:CYCLES]]
    named = [
        replace(c, digest=replace(c.digest, path=f"{k:03} {c.digest.path}")) for k, c in enumerate(told, 1)
    ]
    return Life(judged(named, base, others, RATE), ())


# No field log is unknown: a simulated supply that sags under way, of which no hypothesis knows.
SAGS = Scenario((Move(0.3, 410.0, 2.0), Move(3.3, -410.0, 2.0)), 5.7, fault=Fault("supply", 4.2), seed=4)

# Name of a picture: height of what is shown of its page [px], and how the page is made in a folder.
PAGES: dict[str, tuple[int, Callable[[Path], Path]]] = {
    "overload": (1500, lambda to: write_report(diagnose(ROOT / "data" / "overload_steady.csv.gz"), to)),
    "slip": (1500, lambda to: write_report(diagnose(recorded("field/move_05.csv.gz")), to)),
    "doubtful": (1500, lambda to: write_report(diagnose(recorded("field/move_23.csv.gz")), to)),
    "unknown": (1500, lambda to: write_report(diagnose(simulate(SAGS, name="simulated")[0]), to)),
    "plan": (1300, lambda to: write_report(plan("backlash,position_lag", travel=(-2e-4, 3e-4)), to)),
    "improve": (1700, lambda to: write_report(improve(recorded("field/campaign_e.csv.gz")), to)),
    "trend": (1500, lambda to: write_report(life(), to)),
}


def photograph(page: Path, height: int, out: Path) -> None:
    """The top of a page as a PNG file. Raises UsageError where there is no browser."""
    from playwright.sync_api import sync_playwright

    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    if browser_path is None:
        raise UsageError("there is no chromium to open pages in")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        seen = browser.new_page(viewport={"width": WIDTH, "height": height}, color_scheme="light")
        seen.goto(page.resolve().as_uri())
        seen.wait_for_function(
            "window.observerFiCharts.charts.every(c => c.u || c.plot.closest('details:not([open])'))"
        )
        seen.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        picture = seen.screenshot()
        browser.close()
    Image.open(io.BytesIO(picture)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(
        out, optimize=True
    )


def main(argv: list[str] | None = None) -> int:
    """Take the pictures; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=PAGES, nargs="+", default=list(PAGES), help="some of the pages")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures", help="folder of the pictures")
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.only:
        height, made = PAGES[name]
        with tempfile.TemporaryDirectory() as folder:
            page = made(Path(folder) / name)
            photograph(page, height, args.out / f"page_{name}.png")
        print(f"wrote {args.out / f'page_{name}.png'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
