"""What every test shares: the same hypothesis examples each run, the recorded logs if any."""

import math
import os
from collections import Counter
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# The same examples each run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("observer_fi", derandomize=True, deadline=None)
settings.load_profile("observer_fi")


@pytest.fixture(scope="session")
def recorded_data() -> Path:
    """Folder of recorded logs, from the environment variable OBSERVER_FI_DATA; skips where it is not set."""
    value = os.environ.get("OBSERVER_FI_DATA")
    if not value:
        pytest.skip("OBSERVER_FI_DATA is not set: no recorded logs on this machine")
    folder = Path(value)
    if not folder.is_dir():
        pytest.fail(f"OBSERVER_FI_DATA names {folder}, which is not a folder")
    return folder


@pytest.fixture
def not_on_new_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """`improve` without its count on moves that no fit saw, most of its time: for tests of what it names."""
    from observer_fi.improve.new_moves import UNSEEN

    module = import_module("observer_fi.improve.improvement")
    monkeypatch.setattr(module, "new_moves", lambda *_: UNSEEN)


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what is slow
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a test marked `first(n)`, the cases behind the n-th are slow, or studies where the test itself is slow.

    first(n, m): of a test that is not slow, those behind the m-th are studies.
    """
    seen: Counter[str] = Counter()
    for item in items:
        mark = item.get_closest_marker("first")
        name = item.nodeid.partition("[")[0]
        seen[name] += 1
        if mark is None or seen[name] <= mark.args[0]:
            continue
        if item.get_closest_marker("slow") or seen[name] > max(mark.args[1:], default=math.inf):
            item.add_marker(pytest.mark.study)
        item.add_marker(pytest.mark.slow)


@pytest.hookimpl(optionalhook=True)  # unknown where pytest-xdist is not there
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Every test by itself to the next free worker, but for files with a costly fixture: the others would make it again.

    Not by `xdist_group`: pytest 9.2 takes no notice of the names that pytest-xdist 3.8 gives to the tests of a group.
    """
    from xdist.scheduler import LoadScopeScheduling

    class ByFixture(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            path = nodeid.split("::")[0]
            return path if has_shared_fixture(config.rootpath / path) else nodeid

    return ByFixture(config, log) if config.getvalue("dist") == "load" else None


@cache
def has_shared_fixture(path: Path) -> bool:
    """Whether a file of tests makes something once for several of them."""
    return 'scope="module"' in (text := path.read_text(encoding="utf-8")) or 'scope="session"' in text
