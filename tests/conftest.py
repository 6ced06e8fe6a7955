"""What every test shares: the same hypothesis examples each run, the recorded logs if any."""

import os
from pathlib import Path

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


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that share a costly fixture of their module go to one worker: the others would make it again."""
    for item in items:
        known = getattr(item, "_fixtureinfo", None)
        definitions = [found[-1] for found in known.name2fixturedefs.values()] if known else []
        if any(one.scope == "module" for one in definitions):
            item.add_marker(pytest.mark.xdist_group(str(item.path)))
