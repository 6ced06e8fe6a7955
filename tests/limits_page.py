"""docs/limits.md from the limits in the code: `python tests/limits_page.py`."""

from pathlib import Path

from observer_fi import settings
from observer_fi.bank import log_feed
from observer_fi.improve.moves import simulated_moves
from observer_fi.learn import move_data
from observer_fi.logs import cleaning, columns, ingest, line_parser, tables
from observer_fi.logs.formats import csv, registry, tdms, text_rows, texts, waveforms
from observer_fi.logs.formats.converted import cells, long_tables
from observer_fi.logs.formats.typed import parquet
from observer_fi.logs.logger import acquisition, holds
from observer_fi.physics import PARAMETERS, rig_file
from observer_fi.verdict.logger import lateness, low_pass

PAGE = Path(__file__).parent.parent / "docs" / "limits.md"

INTRO = """# Limits

What is accepted, what is refused, and why. Written by `python tests/limits_page.py` from the limits in the code; a test keeps
it in step. A refusal is one line (file, place, what is wrong, what to do) and exit code 2. What is left out or masked is
listed; after reading, the rows of the file must be the samples and the rows left out, or the log is refused.
"""


def rows_of_logs() -> list[tuple[str, str, str]]:
    """What of a log is limited: what, to what, and what for."""
    fastest, slowest = cleaning.FASTEST_HZ, 1.0 / cleaning.SLOWEST_STEP_S
    return [
        (
            "kind of file",
            f"a regular file ending in {registry.SHOWN_SUFFIXES}",
            "pipes, devices and folders: refused",
        ),
        (
            "while it is read",
            "unchanged",
            "written to, replaced or removed: refused; the hash is of the file that was read",
        ),
        (
            "sampling rate",
            f"{slowest:.0f} to {fastest:.0e} samples a second",
            "slower shows no move; faster is a clock in another unit",
        ),
        ("samples", f"at least {cleaning.FEWEST_SAMPLES}", "fewer: refused"),
        (
            "samples of a log read whole",
            f"{ingest.MOST_WHOLE:,}",
            "`identify`, `improve`, and `diagnose` without a command column; else logs of any length stream",
        ),
        (
            "samples of moves that are fitted",
            f"{move_data.MOST_ROWS:,} by `identify`, {simulated_moves.MOST_ROWS:,} by `improve`, of a rig with a servo",
            "more: moves drawn from the whole of each log, told",
        ),
        (
            "time",
            f"within {columns.COLUMNS['time_s'].limit:g} s of zero",
            "beyond: no time, channels masked, listed",
        ),
        ("rows without a new time", f"{cleaning.STUCK_ROWS:,} in a row", "more: refused"),
        (
            "values beyond their limit",
            f"{100 * cleaning.WRONG_UNIT:.0f} % of a column",
            "more: refused as a wrong unit; fewer: masked, listed",
        ),
        (
            "rows left out",
            "10, or a tenth of the rows",
            "more: refused, as a wrong separator or stray quotes",
        ),
        ("entries of a list", f"{tables.LISTED:,}", "the count is complete"),
        (
            "samples put into gaps",
            f"{log_feed.MOST_MISSING:,} and {log_feed.MISSING_PER_SAMPLE} for each sample",
            "the last part of a long gap is what a bank needs; what is beyond costs nothing",
        ),
        ("length of a line", f"{text_rows.LONGEST_LINE >> 10} KB", "longer: refused"),
        ("blank lines", f"{text_rows.MOST_BLANK:,} more than rows", "more: refused"),
        ("lines before the rows", f"{csv.PREAMBLE_BYTES >> 10} KB", "a header behind that is not found"),
        ("header line", f"{csv.LONGEST_HEADER:,} characters, {csv.MOST_COLUMNS:,} columns", "more: refused"),
        (
            "metadata",
            f"{registry.MOST_METADATA} lines of {registry.LONGEST_METADATA} characters",
            "cut; a line says how many more there are",
        ),
        (
            "text of metadata, names and notes",
            "one line, no control characters",
            "written as escapes (\\x1b)",
        ),
        ("one text table in memory", f"{texts.PIECE_BYTES >> 20} MB at a time", "also of packed files"),
        (
            "JSON, and text with a row a reading",
            f"{cells.MOST_BYTES >> 20} MB, {long_tables.MOST_SIGNALS:,} signals",
            "more: refused",
        ),
        (
            "TDMS channels",
            f"{tdms.MOST_CHANNELS:,}; real numbers; no more samples than the file has bytes for",
            "else: refused",
        ),
        (
            "clocks of TDMS channels",
            f"samples within {waveforms.OFF:g} of an interval of one clock, at most {waveforms.MOST_STRETCH} times their rows",
            "else: refused, with the names of two channels; nothing is interpolated",
        ),
        ("clocks of LVM channels", "the same for all channels", "else: refused, with their names"),
        (
            "row group of a Parquet file",
            f"{parquet.MOST_GROUP_BYTES >> 20} MB, unpacked",
            "refused: write it in smaller row groups",
        ),
        (
            "types of Parquet columns",
            "whole, real and decimal numbers, and texts of numbers",
            "else: refused",
        ),
        (
            "what tells a logger's traits",
            f"the first {acquisition.LONGEST:,} samples; a rest of {acquisition.FEWEST} or more",
            "the rig file's noise; a range that is switched after that is not seen, and may be told as a sensor fault",
        ),
        (
            "rate of held readings",
            f"{holds.TICKS} of them in those samples, half as many at rest and in steady motion",
            "not told; a position at 5 Hz has no kink that tells a lost coupling from a slow start",
        ),
        (
            "steps of readings",
            "a few of them in a move",
            "a position in steps of 2 mm says where the mass was, not when the coupling let go",
        ),
        (
            "delays between channels",
            f"{max(lateness.RELATIVE):g} samples between voltage and current, {max(lateness.COMMON):g} of both, "
            f"{max(lateness.OF_POSITION):g} of the position, and half as much again",
            "log the channels at one time; a fault in the first quarter of a second of a log may pass for a delay",
        ),
        (
            "filter before a channel",
            f"a time constant of {min(low_pass.TIMES):g} to {max(low_pass.TIMES):.0f} samples, order one or Butterworth's two; "
            "one of a group of channels, and one more",
            f"readings that are more than {low_pass.LEFT:.0%} noise without it tell nothing; "
            "identify and improve look for one before voltage, current or both, of a rig with a servo",
        ),
        (
            "inductance of a winding",
            "a time constant of half an interval between samples and more; of shorter ones `identify` tells none, and a start "
            "may look like a voltage sensor",
            "give the one of the data sheet (`rig new --inductance`), or log at 500 Hz and more",
        ),
        ("line of a stream", f"{line_parser.LONGEST_LINE >> 10} KB", "longer: skipped, told"),
    ]


def rows_of_columns() -> list[tuple[str, str]]:
    """The largest believable magnitude of every column of a log."""
    return [(f"`{name}`", f"{kind.limit:g} {kind.unit}") for name, kind in columns.COLUMNS.items()]


def rows_of_rigs() -> list[tuple[str, str, str]]:
    """The range of every parameter of a rig file that has one of its own."""
    found = []
    for name, (low, high) in rig_file.RANGES.items():
        start = "above 0" if low == rig_file.ABOVE_ZERO else f"{low:g}"
        found.append((f"`{name}`", f"{start} to {high:g}", PARAMETERS[name][0]))
    return found


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *lines]) + "\n"


def page() -> str:
    """The whole page."""
    shares = ", ".join(f"`{name}`" for name in settings.AT_MOST_ONE)
    return "\n".join(
        [
            INTRO,
            "## Logs\n",
            table(("what", "limit", "beyond it"), rows_of_logs()),
            "## Values\n",
            "A column map can set another limit for a log (`[limits]`).\n",
            table(("column", "largest magnitude"), rows_of_columns()),
            "## Rig files, settings, column maps\n",
            f"TOML of at most {settings.MOST_BYTES >> 20} MB. Every value has its type (a text or a truth value is no number)",
            "and is finite; noise is above 0, spreads and standard errors are 0 or more; other parameters are within 1e15.\n",
            table(("parameter", "range", "unit"), rows_of_rigs()),
            f"Settings are 0 or more; {shares} are at most 1. In a column map",
            "every header belongs to one column, a separator is one character that is no part of a number, a factor is within",
            "1e15 and not 0 (that of the time above 0), a limit is above 0, the first row stands within",
            f"{columns.MOST_HEADER_LINES:,} lines, and an encoding is one that text can be read in piece by piece.",
            "",
        ]
    )


def main() -> None:
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
