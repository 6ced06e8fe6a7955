"""Still figures: the same bytes for the same arrays, axes that say what they show, and no matplotlib where none is asked for."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from observer_fi.cli import main
from observer_fi.physics import load_rig
from observer_fi.physics.faults import LABELS, OPEN_LOOP, colour_of
from observer_fi.report import diagnose as diagnosed
from observer_fi.report import still_figures
from observer_fi.report.results import figures
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose

DATA = Path(__file__).parents[2] / "data"
T = np.linspace(0.0, 0.4, 200)
DELAYS = [
    {"label": fault, "group": group, **{judge: {"delay_s": delay} for judge, delay in (("bank", 0.02), ("mixture", np.nan))}}
    for fault in ("overload", "coupling_loss")
    for group in ("steady state", "start transient")
]  # fmt: skip
DRAWN = {
    "start": lambda: still_figures.start_figure(1, T, np.sin(T), np.cos(T)),
    "contact": lambda: still_figures.contact_figure((T, T**2), (T, T**2)),
    "residual": lambda: still_figures.residual_norm_figure("title", T, np.full((T.size, 3), (1.0, 2.0, 3.0)), 0.1),
    "delays": lambda: still_figures.delay_figure(DELAYS),
    "force": lambda: still_figures.force_figure(T, T, [still_figures.Curve(T, -T, "a model", colour_of("nominal"))]),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_the_same_arrays_give_the_same_bytes(name: str) -> None:
    first = still_figures.svg(DRAWN[name]())
    with matplotlib.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "axes.facecolor": "black"}):
        again = still_figures.svg(DRAWN[name]())
    assert first == again
    assert first.startswith("<?xml") and "<path" in first
    assert "dc:date" not in first and matplotlib.__version__ not in first


@pytest.mark.parametrize("name", DRAWN)
def test_every_column_of_axes_says_what_it_shows_and_in_which_unit(name: str) -> None:
    figure = DRAWN[name]()
    assert any("[" in axes.get_ylabel() for axes in figure.axes)
    if name != "delays":  # its places are words
        assert "[" in figure.axes[-1].get_xlabel()


def test_a_model_has_the_colour_of_its_fault() -> None:
    lines = DRAWN["residual"]().axes[0].get_lines()
    assert [line.get_color() for line in lines[:3]] == [colour_of(mode) for mode in OPEN_LOOP]
    assert [float(line.get_ydata()[0]) for line in lines[:3]] == [1.0, 2.0, 3.0]  # type: ignore[index]


@pytest.mark.slow
def test_an_outcome_is_drawn_with_the_probabilities_of_its_verdict() -> None:
    outcome = diagnose(DATA / "overload_steady.csv.gz", load_rig(), Settings())
    figure = figures.of_diagnosis(outcome)["verdict"]
    assert isinstance(figure, Figure) and len(figure.axes) == 7
    drawn = {str(line.get_label()): line.get_ydata() for line in figure.axes[6].get_lines()}
    assert outcome.zoom is not None and outcome.isolation is not None
    np.testing.assert_array_equal(drawn["overload"], outcome.zoom.posterior[:, LABELS.index("overload")])
    legend = figure.axes[6].get_legend()
    assert legend is not None and "overload" in [text.get_text() for text in legend.get_texts()]
    assert "overload" in still_figures.svg(figure)
    assert figures.of_diagnosis(replace(outcome, isolation=None)) == {}


def test_a_verdict_of_the_whole_move_stands_in_the_still_figure_too() -> None:
    outcome = diagnose(DATA / "overload_steady.csv.gz", load_rig(), Settings())
    assert outcome.isolation is not None
    event = outcome.isolation.verdict._replace(isolated_s=None)
    told = replace(outcome.isolation, verdict=event, events=(event,))
    figure = figures.of_diagnosis(replace(outcome, isolation=told))["whole_log"]
    last = [line for line in figure.axes[6].get_lines() if "whole move" in str(line.get_label())]
    assert len(last) == 1 and np.nanmax(last[0].get_ydata()) == event.probability


@pytest.mark.slow
def test_diagnose_starts_without_matplotlib(tmp_path: Path) -> None:
    script = (
        "import sys; from observer_fi.cli import main; code = main(sys.argv[1:]); "
        "sys.exit(code or 10 * any(name.split('.')[0] == 'matplotlib' for name in sys.modules))"
    )
    log = DATA / "overload_steady.csv.gz"
    command = [sys.executable, "-c", script, "diagnose", str(log), "--quiet", "--out", str(tmp_path)]
    assert subprocess.run(command, check=False).returncode == 0


@pytest.mark.parametrize(("kind", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_every_kind_of_file_has_the_same_bytes_again(kind: str, begins: bytes) -> None:
    first, again = (still_figures.still_files({"a": DRAWN["contact"]()}, kind) for _ in range(2))
    assert first == again and first[f"a.{kind}"].startswith(begins)


@pytest.mark.slow
def test_figures_are_written_beside_the_page_and_taken_back(tmp_path: Path) -> None:
    log = str(DATA / "coupling_loss_steady.csv.gz")
    folder = tmp_path / "coupling_loss_steady"
    command = ["diagnose", log, "--quiet", "--out", str(tmp_path)]
    assert main([*command, "--figures", "png"]) == 0
    first = {path.name: path.read_bytes() for path in folder.glob("*.png")}
    assert set(first) == {"verdict.png", "whole_log.png"}
    assert main([*command, "--figures", "png"]) == 0
    assert {path.name: path.read_bytes() for path in folder.glob("*.png")} == first
    assert main(command) == 0
    assert not (folder / "verdict.png").exists() and (folder / "report.html").exists()


def test_a_log_that_tells_nothing_has_no_figures(tmp_path: Path) -> None:
    log = tmp_path / "still.csv"
    rows = "".join(f"{0.001 * k:.3f},0,0,0\n" for k in range(400))
    log.write_text("time_s,voltage_v,current_a,position_m\n" + rows)
    assert main(["diagnose", str(log), "--quiet", "--figures", "png", "--out", str(tmp_path)]) == 0
    assert not list((tmp_path / "still").glob("*.png"))
    with pytest.raises(ValueError, match="nothing to draw: not tested"):
        diagnosed(log).plot()


def test_a_wrong_kind_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["diagnose", "log.csv", "--figures", "gif"])
    assert stopped.value.code == 2 and "'png', 'svg', 'pdf'" in capsys.readouterr().err
