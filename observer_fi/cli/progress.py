"""What a command that takes longer says on a terminal meanwhile, on standard error: nothing is said to a file or a pipe."""

import argparse
import contextlib
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

T = TypeVar("T")

DELAY_S = 2.0  # a command that is done sooner says nothing
TICK_S = 0.5
LEAST_SHARE = 0.05  # of the whole that must be over before the rest can be guessed
NO_SHARES: Mapping[str, float] = MappingProxyType({})


def _shown(args: argparse.Namespace) -> bool:
    return not args.quiet and sys.stderr is not None and sys.stderr.isatty()


def progress(items: Iterable[T], args: argparse.Namespace, total: int, unit: str) -> Iterable[T]:
    """`items` with a bar that says how long the rest will take, where there are several."""
    if total < 2 or not _shown(args):
        return items
    from tqdm import tqdm

    return tqdm(items, total=total, unit=unit, leave=False, delay=DELAY_S)


@contextlib.contextmanager
def share_of(args: argparse.Namespace, name: str, alone: bool) -> Iterator[Callable[[float], None]]:
    """Takes how much of one log is done, from 0 to 1, and says how long the rest will take; where it is the only one."""
    if not alone or not _shown(args):
        yield lambda share: None
        return
    from tqdm import tqdm

    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}, {remaining} left"
    with tqdm(total=1.0, desc=name[-40:], leave=False, delay=DELAY_S, bar_format=form) as bar:
        yield lambda share: _to(bar, share)


def _to(bar: Any, share: float) -> None:
    bar.update(max(0.0, share - bar.n))


class Stages:
    """What a long command is doing, for how long already, and how long the rest will take: one line of a terminal.

    shares: by the beginning of a stage's text how much of the whole it usually is. The time left rests on the stages that are
    over; how many there will be depends on what is found on the way, so that it is a guess, told in round figures.
    """

    def __init__(self, args: argparse.Namespace, shares: Mapping[str, float] = NO_SHARES) -> None:
        self.shown, self.text, self.written = _shown(args) and not args.json, "", False
        self.shares, self.over_share = shares, 0.0
        self.begun = self.since = time.monotonic()
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._count, daemon=True)

    def __call__(self, text: str) -> None:
        """The next stage begins."""
        self.over_share += self._share()
        self.text, self.since = text, time.monotonic()

    def _share(self) -> float:
        """What the stage under way usually is of the whole."""
        return next((share for name, share in self.shares.items() if self.text.startswith(name)), 0.0)

    def left_s(self, now: float) -> float | None:
        """Seconds that the rest will take, None where too little is over to tell."""
        if self.over_share < LEAST_SHARE:
            return None
        whole = (self.since - self.begun) / self.over_share
        later = max(1.0 - self.over_share - self._share(), 0.0)
        return whole * later + max(whole * self._share() - (now - self.since), 0.0)

    def __enter__(self) -> "Stages":
        if self.shown:
            self.thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.over.set()
        if self.shown:
            self.thread.join()
            self._write("")

    def _count(self) -> None:
        while not self.over.wait(TICK_S):
            now = time.monotonic()
            if self.text and now - self.begun > DELAY_S:
                left = self.left_s(now)
                rest = "" if left is None else f", about {math.ceil(left)} s left"
                self._write(f"  {self.text}: {now - self.since:.0f} s, {now - self.begun:.0f} s in all{rest}")

    def _write(self, line: str) -> None:
        """This line in place of the one before."""
        if line or self.written:
            with contextlib.suppress(OSError, ValueError):  # nobody to tell
                sys.stderr.write(f"\r\x1b[K{line}")
                sys.stderr.flush()
        self.written = bool(line)


def tell_when_compiling(args: argparse.Namespace) -> None:
    """Say why the first run takes longer, before it does."""
    if not _shown(args) or getattr(args, "json", False):
        return
    from observer_fi.numerics import when_compiling

    text = "  compiling the filters, once for this version: about half a minute"
    when_compiling(lambda: print(text, file=sys.stderr, flush=True))
