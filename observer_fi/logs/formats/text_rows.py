"""Lines of text to blocks of numbers, through pyarrow: a line is a row, and every row is used or listed.

A block of lines goes to arrow as it is. If what comes back is not one row a line (blank lines, comments, a quote that is
never closed and swallows the lines behind it), its lines are looked at one by one first.
"""

import csv
import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer_fi.errors import InvalidLogError
from observer_fi.logs.formats.stamps import Stamps
from observer_fi.logs.plain_cells import no_sample, plain_cell
from observer_fi.logs.tables import NO_VALUE, Block, RowCount, left_out_rows, not_a_number, place, plain
from observer_fi.records import Array, Rejected

LONGEST_LINE = 1 << 18  # bytes: what has no end of line by then is no table
MOST_BLANK = 1_000_000  # blank lines beyond the number of rows
_NUMBER = re.compile(rb"[ \t]*[+-]?((\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|nan|inf|infinity)[ \t]*", re.IGNORECASE)


class TextLayout(NamedTuple):
    """How the rows of a text table stand. used: field of every column; shown: how messages name it.

    fields: of a row; comment: one more may stand behind them and is left out. first_line: line of the first row. missing:
    texts for no value besides `NO_VALUE`. stamps: columns that make the time stamps of time_s, in order; none: it is a number.
    headers: as they stand; sure: whether the table shows its decimal sign.
    """

    fields: int
    separator: str
    decimal: str
    first_line: int
    used: dict[str, int]
    shown: dict[str, str]
    missing: tuple[str, ...] = ()
    comment: bool = False
    stamps: tuple[str, ...] = ()
    headers: tuple[str, ...] = ()
    sure: bool = False


class _Lines(NamedTuple):
    """Lines that are rows, their numbers in the file, and those that had to be left out."""

    text: bytes
    rows: NDArray[np.int64]
    left_out: list[Rejected]
    blank: int


def lines_in(path: str, pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes cut at ends of lines, each of which is one newline then; the last line ends, too."""
    rest = b""
    for piece in pieces:
        data = rest + piece
        end = max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1)) + 1
        rest = data[end:]
        if len(rest) > LONGEST_LINE:
            raise InvalidLogError(
                f"{path}: a line has more than {LONGEST_LINE >> 10} KB; this is no table of rows: export the log as CSV"
            )
        if end:
            yield _newlines(data[:end])
    if rest:
        yield _newlines(rest).removesuffix(b"\n") + b"\n"


def _newlines(data: bytes) -> bytes:
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def without_lines(blocks: Iterable[bytes], count: int) -> Iterator[bytes]:
    """The blocks of lines without the first `count` lines."""
    for block in blocks:
        there = block.count(b"\n") if count else 0
        if there > count or not count:
            at = 0
            for _ in range(count):
                at = block.index(b"\n", at) + 1
            yield block[at:]
        count = max(count - there, 0)


def text_blocks(
    path: str, lines: Iterable[bytes], layout: TextLayout, count: RowCount, stamps: Stamps | None = None
) -> Iterator[Block]:
    """The rows as blocks; stamps: the clock of a layout with time stamps.

    Raises InvalidLogError for a text where a number belongs, and for too many broken rows.
    """
    reader = _Reader(path, layout, stamps)
    for block in lines:
        found = reader.block(block)
        count.rows = reader.line - reader.blank
        yield found


class _Reader:
    """Blocks of lines under way. line: lines so far; blank: those of them without anything; bad: left out."""

    def __init__(self, path: str, layout: TextLayout, stamps: Stamps | None) -> None:
        self.path, self.layout, self.stamps = path, layout, stamps
        self.line = self.blank = self.bad = self.good = 0
        separator = layout.separator.encode()
        self.edges = (separator + b'"', b'"' + separator, b'\n"', b'"\n')
        self.opening = separator + b'"'
        self.weird = re.compile(rb'[^\n"%b]"[^\n"%b]' % ((re.escape(layout.separator.encode()),) * 2))

    def block(self, text: bytes) -> Block:
        text, there = _utf8(text), text.count(b"\n")
        lines = _Lines(text, np.arange(self.line + 1, self.line + there + 1), [], 0)
        found = None
        if not self._opens_quotes(text):
            found = self._plainly(lines, False)
        elif not self._strange_quotes(text):
            found = self._plainly(lines, '"')
        if found is None:
            lines = self._judged(text)
            found = self._plainly(lines, False, judged=True)
        if found is None:
            cleaned = self._cleaned(lines)
            found = cleaned and self._plainly(cleaned, False, judged=True, decimal=".")
        if found is None:
            raise self._not_a_number(lines)
        self.line, self.blank = self.line + there, self.blank + lines.blank
        self.good, self.bad = self.good + found.rows.size, self.bad + found.left_out.total
        self._check(found)
        return found

    def _opens_quotes(self, text: bytes) -> bool:
        """Whether a field begins with a quote; where none does, a quote is a character like any other, 5" for one."""
        return b'"' in text and (self.opening in text or b'\n"' in text or text.startswith(b'"'))

    def _strange_quotes(self, text: bytes) -> bool:
        """Whether there are quotes within a field, or one that is never closed: arrow would read on behind it."""
        quotes = text.count(b'"')
        at_edges = sum(map(text.count, self.edges)) + text.startswith(b'"')
        return quotes % 2 == 1 or (at_edges != quotes and self.weird.search(text) is not None)

    def _plainly(
        self, lines: _Lines, quote: str | bool, judged: bool = False, decimal: str | None = None
    ) -> Block | None:
        """The block if arrow makes one row of every line, else None. judged: lines that are none, or comments, are out; decimal:
        sign of these lines, where it is not the table's.
        """
        import pyarrow as pa

        short: list[Any] = []
        try:
            layout = self.layout._replace(decimal=decimal or self.layout.decimal)
            table = _arrow_table(lines.text, layout, quote, short) if lines.text else None
        except pa.ArrowInvalid:
            return None
        good = table.num_rows if table is not None else 0
        wrong = [(row.number - 1, row.actual_columns) for row in short]
        if good + len(wrong) != lines.rows.size or (not judged and any(self._curable(row) for row in short)):
            return None
        kept = np.delete(lines.rows, [k for k, _ in wrong])
        left_out = [
            Rejected(
                int(lines.rows[k]), "time_s", f"row left out: {n} fields instead of {self.layout.fields}"
            )
            for k, n in wrong
        ]
        used = self.layout.used.items()
        values = {c: _joined(table, field) for c, field in used if c not in self.layout.stamps}
        if self.stamps is not None:
            values["time_s"] = self._times(table, kept, self.stamps)
        return Block(kept, values, left_out_rows([*lines.left_out, *left_out]))

    def _times(self, table: Any, rows: NDArray[np.int64], stamps: Stamps) -> Array:
        """The time stamps of rows as seconds, of a date and a time of day where they stand in two columns."""
        import pyarrow.compute as pc

        if table is None or not table.num_rows:
            return np.empty(0)
        texts = [table.column(f"{self.layout.used[c]}").combine_chunks() for c in self.layout.stamps]
        joined = texts[0] if len(texts) == 1 else pc.binary_join_element_wise(*texts, " ")
        return stamps.of_texts(joined, rows, self.layout.first_line)

    def _curable(self, row: Any) -> bool:
        """Whether a line that arrow cannot use is none (blank), a comment, or fits without its comment."""
        with_comment = self.layout.comment and row.actual_columns == self.layout.fields + 1
        return with_comment or not row.text.strip() or row.text.startswith("#")

    def _judged(self, text: bytes) -> _Lines:
        """The lines that are rows, without quotes and comments; what cannot be a row is left out, listed."""
        kept: list[bytes] = []
        rows: list[int] = []
        left_out: list[Rejected] = []
        blank = 0
        for row, line in enumerate(text.split(b"\n")[:-1], self.line + 1):
            if not line.strip(b" \t\x0b\x0c"):
                blank += 1
                continue
            plain_line, reason = (
                self._row(line, row) if line[:1] == b"#" or self._opens_quotes(line) else (line, "")
            )
            if reason:
                left_out.append(Rejected(row, "time_s", f"row left out: {reason}"))
                continue
            kept.append(self._without_comment(plain_line))
            rows.append(row)
        joined = b"\n".join(kept) + b"\n" if kept else b""
        return _Lines(joined, np.array(rows, dtype=np.int64), left_out, blank)

    def _cleaned(self, lines: _Lines) -> _Lines | None:
        """The lines with plain numbers in the fields that are used, and without rows that are no samples; None where a text is
        neither.
        """
        separator, kept, rows, left_out = self.layout.separator, [], [], list(lines.left_out)
        texts = lines.text.decode("utf-8", "surrogateescape").split("\n")
        for row, line in zip(lines.rows.tolist(), texts, strict=False):
            fields = line.split(separator)
            reason = no_sample(fields, self.layout.headers)
            if reason:
                left_out.append(Rejected(row, "time_s", f"row left out: {reason}"))
                continue
            for column, k in self.layout.used.items() if len(fields) == self.layout.fields else ():
                if column not in self.layout.stamps:
                    cell = self._plain_cell(fields[k])
                    if cell is None:
                        return None
                    fields[k] = cell
            kept.append(separator.join(fields))
            rows.append(row)
        text = "".join(line + "\n" for line in kept).encode("utf-8", "surrogateescape")
        return _Lines(text, np.array(rows, dtype=np.int64), left_out, lines.blank)

    def _plain_cell(self, text: str) -> str | None:
        missing = text.strip() in self.layout.missing
        return "" if missing else plain_cell(text, self.layout.decimal, self.layout.sure)

    def _row(self, line: bytes, row: int) -> tuple[bytes, str]:
        """A line with quotes or a comment as plain fields, or the reason why it is no row."""
        if line.startswith(b"#"):
            return line, "a comment"
        text, separator = line.decode("utf-8", "surrogateescape"), self.layout.separator
        try:
            fields = next(csv.reader([text], delimiter=separator, strict=True))
        except csv.Error:
            return line, "a quote is not closed, or stands within a field"
        if text.count(separator) == len(fields) - 1:
            return separator.join(fields).encode("utf-8", "surrogateescape"), ""
        for column, k in self.layout.used.items():
            if k < len(fields) == self.layout.fields and separator in fields[k]:
                cell = self._plain_cell(fields[k])
                if cell is not None:
                    fields[k] = cell
                    continue
                where = self.layout.first_line + row - 1
                raise not_a_number(self.path, row, self.layout.shown[column], fields[k], where)
        plain_fields = ["" if separator in field else field for field in fields]
        return separator.join(plain_fields).encode("utf-8", "surrogateescape"), ""

    def _without_comment(self, line: bytes) -> bytes:
        separator = self.layout.separator.encode()
        if self.layout.comment and line.count(separator) == self.layout.fields:
            return line[: line.rindex(separator)]
        return line

    def _check(self, found: Block) -> None:
        """A broken line now and then is a hiccup of the logger; every second line is a wrong separator."""
        if self.bad > max(10, self.good // 10) and found.left_out.total:
            first = found.left_out.entries[0]
            where = place(first.row, self.layout.first_line + first.row - 1)
            reason = first.reason.removeprefix("row left out: ").replace("instead of", "where the header has")
            raise InvalidLogError(
                f"{self.path}: {where}: {reason}, and {self.bad} rows like it; check the separator "
                f"({self.layout.separator!r}), quotes and comments"
            )
        if self.blank > MOST_BLANK + self.good:
            raise InvalidLogError(
                f"{self.path}: {self.blank} lines are blank; remove them, or export it again"
            )

    def _not_a_number(self, lines: _Lines) -> InvalidLogError:
        """The error that names the first field that is no number."""
        separator, missing = self.layout.separator.encode(), {*NO_VALUE, *self.layout.missing}
        for row, line in zip(lines.rows.tolist(), lines.text.split(b"\n"), strict=False):
            fields = line.split(separator)
            for column, k in self.layout.used.items() if len(fields) == self.layout.fields else ():
                if column in self.layout.stamps:
                    continue
                field = fields[k].replace(self.layout.decimal.encode(), b".", 1)
                text = fields[k].decode("utf-8", "replace")
                if not _NUMBER.fullmatch(field) and text not in missing and self._plain_cell(text) is None:
                    where = self.layout.first_line + row - 1
                    return not_a_number(self.path, row, self.layout.shown[column], text, where)
        first = int(lines.rows[0]) if lines.rows.size else self.line + 1
        return InvalidLogError(
            f"{self.path}: {place(first, self.layout.first_line + first - 1)} and the rows behind it cannot be read as "
            "a table of numbers; export it again"
        )


def _utf8(text: bytes) -> bytes:
    """The text with a mark for what is no UTF-8: arrow cannot hand such a line out, and no number needs it."""
    if text.isascii():
        return text
    return text.decode("utf-8", "replace").encode("utf-8")


def _arrow_table(text: bytes, layout: TextLayout, quote: str | bool, short: list[Any]) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    def leave_out(row: Any) -> str:
        short.append(row)
        return "skip"

    names = [f"{k}" for k in range(layout.fields)]
    wanted = {names[k]: pa.string() if c in layout.stamps else pa.float64() for c, k in layout.used.items()}
    read = pacsv.ReadOptions(use_threads=False, block_size=len(text) + 1, column_names=names)
    parse = pacsv.ParseOptions(
        delimiter=layout.separator, quote_char=quote, double_quote=bool(quote), invalid_row_handler=leave_out
    )
    convert = pacsv.ConvertOptions(
        column_types=wanted,
        include_columns=list(wanted),
        null_values=[*NO_VALUE, *layout.missing],
        decimal_point=layout.decimal,
        strings_can_be_null=True,
    )
    return pacsv.open_csv(pa.py_buffer(text), read, parse, convert).read_all()


def _joined(table: Any, field: int) -> Array:
    if table is None or not table.num_rows:
        return np.empty(0)
    chunks = [plain(chunk) for chunk in table.column(f"{field}").chunks]
    return chunks[0] if len(chunks) == 1 else np.concatenate(chunks)
