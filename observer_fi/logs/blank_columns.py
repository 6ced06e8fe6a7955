"""Tables whose columns stand between blanks, as Fortran, instruments and printers write them: fields of a line by their place."""

import re
from collections.abc import Iterable, Iterator

_WORD = re.compile(r"\S+")
_NAME = re.compile(r"\S+(?: [\[(][^\])]*[\])])?")


def blank_headers(line: str, fields: int) -> list[str]:
    """The names of so many columns: words, what stands between two blanks or more, or words with a unit in brackets each."""
    named = (line.split(), re.split(r"\s{2,}", line.strip()), _NAME.findall(line))
    return next((names for names in named if len(names) == fields), named[0])


class BlankColumns:
    """Lines of one table under way. spans: from where to where each of its columns was written so far."""

    def __init__(self, fields: int) -> None:
        self.fields = fields
        self.spans: list[tuple[int, int]] = []

    def tabbed(self, blocks: Iterable[bytes]) -> Iterator[bytes]:
        """The same lines with a tab between fields, and none elsewhere."""
        for block in blocks:
            lines = block.decode("utf-8", "surrogateescape").split("\n")
            yield "\n".join(map(self._tabbed, lines)).encode("utf-8", "surrogateescape")

    def _tabbed(self, line: str) -> str:
        if line.startswith("#"):
            return line
        found = list(_WORD.finditer(line))
        if len(found) == self.fields:
            spans = self.spans or [word.span() for word in found]
            self.spans = [
                (min(a, w.start()), max(b, w.end())) for (a, b), w in zip(spans, found, strict=True)
            ]
            return "\t".join(word.group() for word in found)
        return "\t".join(self._placed(found) if found and self.spans else [word.group() for word in found])

    def _placed(self, found: list[re.Match[str]]) -> list[str]:
        """Fields of a line with blanks in place of values; the words as they come where one stands in no column, or in two."""
        placed = [""] * self.fields
        for word in found:
            under = [k for k, (a, b) in enumerate(self.spans) if word.start() < b and word.end() > a]
            if len(under) != 1 or placed[under[0]]:
                return [word.group() for word in found]
            placed[under[0]] = word.group()
        return placed
