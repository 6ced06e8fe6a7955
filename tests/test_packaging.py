"""What a person reads first is true: version, commands, options, make targets and links of README."""

import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest

import observer_fi

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def code_of(page: str) -> list[str]:
    """Lines of the fenced blocks, then the inline spans, of a Markdown page."""
    fence = re.compile(r"^```.*?\n(.*?)^```", re.MULTILINE | re.DOTALL)
    joined = [block.replace("\\\n", " ") for block in fence.findall(page)]
    return [line for block in joined for line in block.splitlines()] + re.findall(
        r"`([^`\n]+)`", fence.sub("", page)
    )


def invocations(page: str) -> list[tuple[str, set[str]]]:
    """(command, its long options) of each `observer-fi COMMAND` or `python -m observer_fi COMMAND`."""
    found = []
    for line in code_of(page):
        for part in re.split(r"[|;]|&&|\s#\s", line):
            match = re.search(r"(?:observer-fi|-m observer_fi)\s+([a-z][a-z-]*)(.*)", part)
            if match:
                found.append((match[1], set(re.findall(r"(?<!\S)--[a-z][a-z-]*", match[2]))))
    return found


@cache
def help_of(*command: str) -> str:
    run = subprocess.run(
        [sys.executable, "-m", "observer_fi", *command, "--help"],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "COLUMNS": "300"},  # no help is wrapped: a wrapped word would pass for a command
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def listed_commands() -> set[str]:
    """Subcommands in the help: a line each, indented, or the {a,b,c} of argparse."""
    text = help_of()
    braces = {name for group in re.findall(r"\{([a-z,-]+)\}", text) for name in group.split(",")}
    return braces | set(re.findall(r"^ {2,}([a-z][a-z-]*)(?: {2,}|$)", text, re.MULTILINE))


def test_the_readme_is_parsed_as_meant() -> None:
    page = "```sh\n$ observer-fi diagnose a.csv \\\n  --out x | cat\n```\nor `python -m observer_fi watch`"
    assert invocations(page) == [("diagnose", {"--out"}), ("watch", set())]


def test_version_is_that_of_the_installed_package() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert observer_fi.__version__ == version("observer-fi") == declared


def test_every_command_of_the_readme_exists() -> None:
    assert {command for command, _ in invocations(README)} <= listed_commands()


def test_every_command_stands_in_the_readme() -> None:
    assert listed_commands() <= {command for command, _ in invocations(README)}


def test_every_option_of_the_readme_exists() -> None:
    missing = [
        (command, option)
        for command, options in invocations(README)
        for option in options
        if option not in help_of(command)
    ]
    assert not missing


def test_every_make_target_of_the_readme_exists() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {target for line in code_of(README) for target in re.findall(r"^make ([a-z]+)", line)}
    assert {"demo", "test"} <= named <= targets


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []
