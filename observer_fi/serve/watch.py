"""The bank on a live stream: lines from standard input or a growing file, one JSON line per change of verdict, or one in words.

The stream goes lines -> samples (`lines.py`) -> bank and verdict (`live.py`) -> lines. A signal ends it cleanly.
"""

import contextlib
import gc
import io
import json
import math
import os
import select
import signal
import stat
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs import (
    PLAIN,
    BrokenLineError,
    Clock,
    ColumnMap,
    Parser,
    Row,
    Splitter,
    lines_of,
    numbers,
)
from observer_fi.physics import LABELS, NOT_TESTED, Rig, label_of
from observer_fi.records import Array, Estimate, Event
from observer_fi.serve.live import Change, Live, table_of
from observer_fi.settings import Settings

SCHEMA = "observer-fi/watch/1"
READ_BYTES = 1 << 16
TAIL_BYTES = 1 << 12  # of what was read last: a file that was rewritten has others there
FEW_BYTES = 1 << 12  # of lines: fewer are parsed sooner one by one
PATIENCE_S = 1.0  # that a write may take after a signal
BUSY_S, IDLE_S = 5e-4, 0.02  # how often a file is looked at while it grows, and when it has not for a second


@dataclass(frozen=True)
class Options:
    """What a user may choose. every: samples between lines with the posterior, 0 for none; heartbeat_s: seconds without
    a line after which one is written, 0 for none; text: words instead of JSON."""

    rig: Rig
    settings: Settings
    columns: ColumnMap = PLAIN
    engine: str = "compiled"
    filter_kind: str = "ekf"
    every: int = 0
    heartbeat_s: float = 0.0
    quiet: bool = False
    text: bool = False


class Pipe:
    """Standard input, or any other descriptor that ends."""

    name = "standard input"

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor

    def read(self, wake: int, timeout: float) -> bytes | None:
        """The next bytes; b"" after `timeout` seconds without any, None at the end."""
        ready, _, _ = select.select([self.descriptor, wake], [], [], timeout)
        if self.descriptor not in ready:
            return b""
        try:
            return os.read(self.descriptor, READ_BYTES) or None
        except OSError as error:
            raise UsageError(
                f"{self.name}: cannot read it ({error.strerror}); pipe lines of text into it"
            ) from error

    def renewed(self) -> str:
        """Whether another writer has begun: a pipe cannot know."""
        return ""

    def close(self) -> None:
        """Nothing to close: the descriptor is the caller's."""


class Growing:
    """A file that another process writes; it may be cut, rewritten in place, or replaced by a new one of the same name."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, str(path)
        self.descriptor, self.news = -1, ""
        self.last_growth = -math.inf
        self._open()

    def _open(self) -> None:
        """Open what has the name now; nothing, where nothing has. Raises UsageError for what is no plain file."""
        self._begin()
        try:
            self.descriptor = os.open(
                self.path, os.O_RDONLY | os.O_NONBLOCK
            )  # a FIFO would wait for its writer
        except FileNotFoundError:
            return
        except OSError as error:
            raise UsageError(
                f"{self.path}: cannot follow it ({error.strerror}); check the path and its permissions"
            ) from error
        if not stat.S_ISREG(os.fstat(self.descriptor).st_mode):
            self.close()
            raise UsageError(
                f"{self.path}: not a plain file, so it cannot be followed; pipe it into observer-fi watch instead"
            )

    def _begin(self) -> None:
        """Nothing read yet: position, checksum and last bytes of what has been, and the file's change time then."""
        self.position = self.checksum = 0
        self.tail = b""
        self.changed: int | None = None

    def read(self, wake: int, timeout: float) -> bytes | None:
        """The next bytes; b"" after `timeout` seconds without any. A growing file has no end. Raises UsageError."""
        until = time.monotonic() + timeout
        while True:
            data = self._grown()
            now = time.monotonic()
            if data or self.news or now >= until:
                self.last_growth = now if data else self.last_growth
                return data
            pause = BUSY_S if now - self.last_growth < 1.0 else IDLE_S
            if select.select([wake], [], [], min(pause, until - now))[0]:
                return b""

    def _grown(self) -> bytes:
        if self.descriptor < 0:
            self._open()
            if self.descriptor < 0:
                return b""
        try:
            if self._rewritten():
                self._begin()
                self.news = "the file was rewritten"
                return b""
            data = os.pread(self.descriptor, READ_BYTES, self.position)
            if not data:
                self._look_for_restart()
        except OSError as error:
            raise UsageError(f"{self.path}: cannot read it any more ({error.strerror})") from error
        self.position += len(data)
        self.checksum = zlib.crc32(data, self.checksum)
        self.tail = (self.tail + data)[-TAIL_BYTES:]
        now = os.fstat(self.descriptor)
        if data and now.st_size == self.position:  # what is written from now on changes the time again
            self.changed = now.st_mtime_ns
        return data

    def _rewritten(self) -> bool:
        """Whether what has been read is no longer what stands there."""
        now = os.fstat(self.descriptor)
        if now.st_size < self.position or now.st_mtime_ns == self.changed:
            return False
        idle, self.changed = self.changed is not None and now.st_size == self.position, now.st_mtime_ns
        if idle:  # it was written to, and did not grow
            return self._checksum() != self.checksum
        return os.pread(self.descriptor, len(self.tail), self.position - len(self.tail)) != self.tail

    def _checksum(self) -> int:
        """Of the bytes up to the position."""
        checksum = 0
        for first in range(0, self.position, READ_BYTES):
            data = os.pread(self.descriptor, min(READ_BYTES, self.position - first), first)
            checksum = zlib.crc32(data, checksum)
        return checksum

    def _look_for_restart(self) -> None:
        try:
            found = os.stat(self.path)
        except OSError:
            return  # between two files: what is open can still grow
        opened = os.fstat(self.descriptor)
        if (found.st_dev, found.st_ino) != (opened.st_dev, opened.st_ino):
            self.close()
            self._open()
            self.news = "the file was replaced"
        elif found.st_size < self.position:
            self._begin()
            self.news = "the file was cut"

    def renewed(self) -> str:
        """What happened, if the file began anew since the last call."""
        news, self.news = self.news, ""
        return news

    def close(self) -> None:
        """Close the file."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


class Watch:
    """One source under way, from bytes to lines of output."""

    def __init__(
        self, options: Options, name: str, out: "TextIO | Breakable", complain: Callable[[str], None]
    ) -> None:
        self.options, self.name, self.out, self.complain = options, name, out, complain
        self._formatted = _worded if options.text else _json_line
        rig = options.rig
        self.parser = Parser(name, options.columns, rig.law, rig.model.vector)
        self.splitter, self.clock = Splitter(), Clock()
        self.live = self._new_live()
        self.rows: list[Row] = []
        self.tables: list[Array] = []  # samples before those of `rows`
        self.last_t = math.nan
        self.skipped = self.faulty = self.moves = self.samples = 0
        self.untested = True

    def _new_live(self) -> Live:
        o = self.options
        return Live(o.rig, o.settings, o.engine, o.filter_kind)

    def take(self, data: bytes) -> None:
        """Bytes of the source."""
        self._block(self.splitter.block(data))
        self._feed()

    def _block(self, block: bytes) -> None:
        """Lines: at once where all are plain samples in order, else each half for itself, and a few one by one."""
        if len(block) < FEW_BYTES:
            self._lines(block)
        elif not self._at_once(block):
            middle = block.find(b"\n", len(block) // 2) + 1
            if middle == len(block):
                self._lines(block)
            else:
                self._block(block[:middle])
                self._block(block[middle:])

    def _lines(self, block: bytes) -> None:
        for line in lines_of(block):
            self._line(line)

    def _at_once(self, block: bytes) -> bool:
        table = self.parser.table(block)
        if table is None or not self.clock.passes(table):
            return False
        self.parser.number += block.count(b"\n")
        self._hold(table)
        return True

    def _line(self, line: str) -> None:
        try:
            row = self.parser.row(line)
        except BrokenLineError as error:
            self._skip(str(error))
            return
        if self.parser.restarted:
            self._feed()
            self._new_clock("the header stands there again")
        if row is None:
            return
        for ready in self.clock.take(row, self._skip):
            if ready is None:
                self._feed()
                self._restart_bank(f"the clock jumped back from {self.last_t:.9g} s")
            else:
                self.rows.append(ready)

    def _skip(self, what: str, samples: int = 1) -> None:
        self.skipped += samples
        self.complain(f"{self.name}: line {self.parser.number}: {what}; skipped")

    def _hold(self, table: Array) -> None:
        """Samples (n, 6) behind those that wait to be fed."""
        self.tables += [table_of(self.rows), table] if self.rows else [table]
        self.rows.clear()

    def _feed(self) -> None:
        """All that waits, in one piece: how it was parsed must not change a digit."""
        table = table_of(self.rows)
        if self.tables:
            table = np.concatenate((*self.tables, table))
        self.rows.clear()
        self.tables.clear()
        if len(table):
            self.last_t = float(table[-1, 0])
            self.live.without_pitch = None if self.parser.has_pitch else self.options.rig
            self._tell(self.live.add(table))

    def _tell(self, judged: Iterator[tuple[Estimate, list[Change]]]) -> None:
        for e, changes in judged:
            before, done = self.live.samples - e.t.size, 0
            for change in changes:
                self._posteriors(e, before, done, change.samples - before)
                done = change.samples - before
                self._write("verdict", change.time_s, change.event, change.moves, change.samples)
            self._posteriors(e, before, done, e.t.size)

    def _posteriors(self, e: Estimate, before: int, first: int, last: int) -> None:
        """Every Nth sample of a stream, of those from first to last of an estimate with `before` samples ahead of it."""
        every = self.options.every
        for k in range(first + (-before - first - 1) % every, last, every) if every else ():
            line = {"schema": SCHEMA, "event": "sample", "time_s": float(e.t[k])}
            self._line_out(line | {"posterior": posterior(e.modes, e.probability[k])})

    def restart(self, reason: str) -> None:
        """The writer began anew: a header, another clock, another bank."""
        if self.splitter.last():
            self._skip("the line breaks off")
        self.parser.begin()
        self._new_clock(reason)

    def _new_clock(self, reason: str) -> None:
        self._flush()
        self.clock = Clock()
        self._restart_bank(reason)

    def _restart_bank(self, reason: str) -> None:
        self._tell(self.live.finish())
        if not self.options.quiet:
            self.complain(f"{self.name}: {reason}: a new bank begins")
        self._state("restart", reason)
        self._count()
        self.live = self._new_live()

    def _count(self) -> None:
        self.samples, self.moves = self.samples + self.live.samples, self.moves + self.live.moves
        label = self.live.verdict().label
        self.faulty += self.live.faulty + (label not in ("nominal", NOT_TESTED))
        self.untested &= label == NOT_TESTED

    def _flush(self) -> None:
        self.rows.extend(self.clock.finish(self._skip))
        self._feed()

    def heartbeat(self) -> None:
        """A line that says that nothing changed."""
        self._state("heartbeat")

    def finish(self, reason: str) -> bool:
        """The last verdict; whether any move had a fault, or none was tested."""
        self._block(self.splitter.last())
        self._flush()
        self._tell(self.live.finish())
        self._state("end", reason)
        self._count()
        return self.faulty > 0 or self.untested

    def _state(self, event: str, reason: str | None = None) -> None:
        self._write(event, self.last_t, self.live.verdict(), self.live.moves, self.live.samples, reason)

    def _write(
        self, event: str, now: float, verdict: Event, moves: int, samples: int, reason: str | None = None
    ) -> None:
        line: dict[str, Any] = {
            "schema": SCHEMA,
            "event": event,
            "time_s": now,
            "label": verdict.label,
            "channel": verdict.channel,
            "probability": verdict.probability,
            "posterior": verdict.posterior,
            "since_s": verdict.isolated_s,
            "detected_s": verdict.detected_s,
            "move": self.moves + moves,
            "move_start_s": verdict.start_s,
            "samples": self.samples + samples,
            "skipped": self.skipped,
            "reasons": [*verdict.reasons, *([reason] if reason else [])],
        }
        self._line_out(line)

    def _line_out(self, line: dict[str, Any]) -> None:
        values = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in line.items()}
        self.out.write(self._formatted(values) + "\n")
        self.out.flush()


def _worded(line: dict[str, Any]) -> str:
    from observer_fi.serve.watch_words import in_words  # pages and their templates come with it

    return in_words(line)


def _json_line(line: dict[str, Any]) -> str:
    return json.dumps(line, allow_nan=False)


def posterior(modes: tuple[str, ...], probability: Array) -> dict[str, float]:
    """Probabilities of the hypotheses, (m,), by label."""
    found = dict.fromkeys(LABELS, 0.0)
    for mode, p in zip(modes, probability.tolist(), strict=True):
        found[label_of(mode)] += p
    return found


def watch(source: Pipe | Growing, options: Options, out: TextIO, complain: Callable[[str], None]) -> bool:
    """Follow a source until it ends, or until SIGINT or SIGTERM; whether any move had a fault, or none was tested.

    Raises InvalidLogError for a stream of which no line can be used (no header, a column missing), UsageError where it can
    no longer be read or told.
    """
    with signals() as stop:
        warm_up(options)
        flow = Watch(options, source.name, Breakable(out, stop), stop.breakable(complain))
        try:
            return _followed(source, flow, stop)
        except StoppedError:  # while nobody took what was written
            let_go(sys.stdout, sys.stderr)
            return flow.faulty > 0


def _followed(source: Pipe | Growing, flow: "Watch", stop: "Stop") -> bool:
    """The source to its end."""
    last_beat, beat = time.monotonic(), flow.options.heartbeat_s
    while True:
        timeout = max(0.0, last_beat + beat - time.monotonic()) if beat else 1.0
        try:
            data = source.read(stop.wake, min(timeout, 1.0))
        except UsageError:
            flow.finish("the source cannot be read any more")
            raise
        if stop.came:
            return flow.finish("stopped by a signal")
        if data is None:
            return flow.finish("the stream ended")
        news = source.renewed()
        if news:
            flow.restart(news)
        if data:
            flow.take(data)
        if beat and time.monotonic() - last_beat >= beat:
            flow.heartbeat()
            last_beat = time.monotonic()


def warm_up(options: Options) -> None:
    """Load the kernels and the parser, and leave nothing to the garbage collector, before the first line comes."""
    numbers(b"0\n", ",", ".", 1, (0,))
    live = Live(options.rig, options.settings, options.engine, options.filter_kind)
    for k in range(80):
        for _ in live.add([Row(k * 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0)]):
            pass
    gc.collect()
    gc.freeze()


class StoppedError(Exception):
    """A signal came while a write waited for a reader that takes nothing."""


class Stop:
    """Whether SIGINT or SIGTERM came. wake: a descriptor that wakes `select` when one does."""

    def __init__(self, wake: int) -> None:
        self.wake, self.came, self.writing = wake, False, False

    def on_signal(self, number: int, frame: object) -> None:
        """Take note; a write gets PATIENCE_S to end by itself."""
        self.came = True
        signal.setitimer(signal.ITIMER_REAL, PATIENCE_S, PATIENCE_S)

    def on_alarm(self, number: int, frame: object) -> None:
        """Break off a write that still waits."""
        if self.writing:
            raise StoppedError

    def breakable(self, write: Callable[[str], object]) -> Callable[[str], None]:
        """The same function, which `on_alarm` can break off."""

        def written(text: str) -> None:
            self.writing = True
            try:
                write(text)
            finally:
                self.writing = False

        return written


class Breakable(io.TextIOBase):
    """Output whose writes a signal can break off, each flushed at once. Raises UsageError where it takes nothing."""

    def __init__(self, out: TextIO, stop: Stop) -> None:
        self.out, self._put = out, stop.breakable(self._through)

    def _through(self, text: str) -> None:
        self.out.write(text)
        self.out.flush()

    def write(self, text: str) -> int:
        """Write and flush."""
        try:
            self._put(text)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise OutputError(
                f"standard output cannot be written ({error.strerror}); free the disk, or read it"
            ) from error
        return len(text)


def let_go(*streams: TextIO | None) -> None:
    """Nobody takes what is still to be written: the interpreter's last flush must not fail or wait for it."""
    for stream in streams:
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())  # type: ignore[union-attr]


class OutputError(UsageError):
    """Output that nobody takes."""


@contextlib.contextmanager
def signals() -> Iterator[Stop]:
    """SIGINT and SIGTERM are noted instead of ending the process; handlers are put back at the end."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    stop = Stop(read)
    wanted = {signal.SIGINT: stop.on_signal, signal.SIGTERM: stop.on_signal, signal.SIGALRM: stop.on_alarm}
    before = {number: signal.signal(number, handler) for number, handler in wanted.items()}
    before_fd = signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    try:
        yield stop
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.set_wakeup_fd(before_fd)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(read)
        os.close(write)


def run(args: Any, complain: Callable[[str], None]) -> int:
    """The command: 0, or 3 with --fail-on-fault after a fault."""
    from observer_fi.logs import load_columns
    from observer_fi.physics import load_rig
    from observer_fi.settings import load_settings

    columns = load_columns(args.columns) if args.columns else PLAIN
    options = Options(
        load_rig(args.rig), load_settings(args.settings), columns, args.engine, args.filter, args.every,
        args.heartbeat, args.quiet, args.text,
    )  # fmt: skip
    if args.follow is None and sys.stdin is None:
        raise UsageError("standard input is closed: pipe a logger into watch, or give --follow FILE")
    if args.follow is None and sys.stdin.isatty():
        raise UsageError(
            "watch reads samples from standard input: pipe a logger into it, or give --follow FILE"
        )
    source = Pipe(sys.stdin.fileno()) if args.follow is None else Growing(args.follow)
    try:
        faulty = watch(source, options, sys.stdout, complain)
    except OutputError:
        let_go(sys.stdout)
        raise
    finally:
        source.close()
    return 3 if faulty and args.fail_on_fault else 0


__all__ = ["InvalidLogError", "Options", "Pipe", "Growing", "Watch", "watch"]
