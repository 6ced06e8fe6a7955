"""The recipes of pipelines/ that end in reports run on short input."""

import shutil
from pathlib import Path

import pandas as pd
import pytest

from pipelines import compare_mixture, diagnose_logs, reproduce_paper

DATA = Path(__file__).parent.parent / "data"


def test_a_folder_of_logs_becomes_reports_and_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    shutil.copy(DATA / "overload_steady.csv.gz", logs)
    (logs / "broken.csv").write_text("time_s\n1\n")
    assert diagnose_logs.main([str(logs), "--out", str(tmp_path / "out")]) == 2
    table = pd.read_csv(tmp_path / "out" / "summary.csv", index_col="log")
    assert table.loc["overload_steady.csv.gz", "label"] == "overload"
    assert "broken.csv" in table.loc["broken.csv", "error"]
    assert (tmp_path / "out" / "overload_steady" / "report.html").exists()
    assert "overload" in capsys.readouterr().out


@pytest.mark.slow
def test_the_papers_figures_come_out_right(tmp_path: Path) -> None:
    """Exit 0 says that figures 5 to 7 isolate the fault that was put in."""
    assert reproduce_paper.main(["--out", str(tmp_path / "out")]) == 0
    assert {f"figure_{k}.svg" for k in range(1, 8)} < {p.name for p in (tmp_path / "out").iterdir()}


@pytest.mark.slow
def test_the_comparison_writes_its_page(tmp_path: Path) -> None:
    assert compare_mixture.main(["--cases", "3", "--out", str(tmp_path / "out")]) == 0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"compare.html", "compare.json", "delays.svg"}
