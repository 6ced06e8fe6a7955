"""The house: what the root holds, how large a room may be, and that rooms are entered by their front door only."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "observer_fi"
ROOMS = sorted(folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").exists())
AT_THE_ROOT = {
    "__init__.py",
    "__main__.py",
    "errors.py",
    "py.typed",
    "records.py",
    "settings.py",
}
MOST_MODULES = 16
USERS = [*PACKAGE.rglob("*.py"), *(ROOT / "pipelines").glob("*.py"), *(ROOT / "benchmarks").glob("*.py")]


def room_of(path: Path) -> str | None:
    inside = path.relative_to(ROOT).parts
    return inside[1] if inside[0] == PACKAGE.name and len(inside) > 2 else None


def imported_modules(path: Path) -> list[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    return named + [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]


def test_the_root_holds_what_every_room_shares() -> None:
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} == AT_THE_ROOT


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_can_be_seen_at_a_glance(room: str) -> None:
    for folder in {path.parent for path in (PACKAGE / room).rglob("*.py")}:  # the room, and a room within it
        assert 0 < len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST_MODULES
    assert ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", USERS, ids=lambda path: str(path.relative_to(ROOT)))
def test_rooms_are_entered_by_what_they_offer(path: Path) -> None:
    for module in imported_modules(path):
        parts = module.split(".")
        if parts[0] == PACKAGE.name and len(parts) > 2:
            assert parts[1] == room_of(path), f"{module}: import it from observer_fi.{parts[1]}"


@pytest.mark.parametrize("room", ROOMS)
def test_modules_of_a_room_import_one_way(room: str) -> None:
    """Peels off modules that import none of those left; what cannot be peeled off is a circle."""
    below = {module_of(path): set(imported_modules(path)) for path in (PACKAGE / room).rglob("*.py")}
    left = {name: below[name] & below.keys() - {name} for name in below}
    while free := {name for name, needed in left.items() if not needed}:
        left = {name: needed - free for name, needed in left.items() if name not in free}
    assert not left


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)
