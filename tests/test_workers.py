"""How tests are shared out to workers."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FILE = """
import os, time, pytest

@pytest.fixture{scope}
def made():
    return os.getpid()

@pytest.mark.parametrize("k", range(6))
def test_one(made, k):
    time.sleep(0.1)
    print(made, file=open("{told}", "a"))
"""


@pytest.mark.slow
def test_a_fixture_of_a_module_is_made_by_one_worker_and_all_workers_have_work(tmp_path: Path) -> None:
    """It was made by each of them: twice the time of every costly one."""
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    for name, scope in (("shared", '(scope="module")'), ("alone", "")):
        (tmp_path / f"test_{name}.py").write_text(FILE.format(scope=scope, told=tmp_path / name))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path, env={**os.environ, "PYTEST_ADDOPTS": ""}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    makers = {name: (tmp_path / name).read_text().split() for name in ("shared", "alone")}
    assert len(makers["shared"]) == len(makers["alone"]) == 6
    assert len(set(makers["shared"])) == 1 < len({*makers["alone"], *makers["shared"]})


TIERS = """
import pytest

@pytest.mark.first(1, 3)
@pytest.mark.parametrize("k", range(5))
def test_fast(k): pass

@pytest.mark.slow
@pytest.mark.first(2)
@pytest.mark.parametrize("k", range(5))
def test_slow(k): pass
"""


@pytest.mark.parametrize(
    ("tier", "cases"),
    [
        ("not slow and not study", {"test_fast[0]"}),
        ("slow and not study", {"test_fast[1]", "test_fast[2]", "test_slow[0]", "test_slow[1]"}),
        ("study", {"test_fast[3]", "test_fast[4]", "test_slow[2]", "test_slow[3]", "test_slow[4]"}),
    ],
)
def test_cases_behind_the_first_run_one_tier_later(tier: str, cases: set[str], tmp_path: Path) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_tiers.py").write_text(TIERS)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", "-m", tier, str(tmp_path)],
        cwd=tmp_path, env={**os.environ, "PYTEST_ADDOPTS": ""}, capture_output=True, text=True,
    )  # fmt: skip
    assert {line.split("::")[1] for line in done.stdout.splitlines() if "::" in line} == cases, done.stdout
