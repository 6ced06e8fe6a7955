"""Commands that documents show, and the lines that they are said to print."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "data" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
_FENCED = re.compile(r"^```(?:sh|console|)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def steps(text: str) -> Iterator[tuple[str, list[str]]]:
    """Each command of the ```console blocks of a text, and the lines that stand below it."""
    for block in re.findall(r"```console\n(.*?)```", text, re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, *lines = part.strip().splitlines()
            yield command, lines


def shown(path: Path) -> list[list[str]]:
    """Words of every `observer-fi` that a document shows to be typed, without the program."""
    found = []
    for block in _FENCED.findall(path.read_text(encoding="utf-8")):
        for line in block.replace("\\\n", " ").splitlines():
            for part in line.removeprefix("$ ").split(" < ")[0].split(" | "):
                words = shlex.split(part, comments=True) if part.startswith("observer-fi ") else []
                found += [words[1:]] if words else []
    return found
