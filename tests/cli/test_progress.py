"""What a terminal is told while a command runs: after two seconds, on standard error, with the time that is left."""

import argparse
import io
import shlex
import sys
import time
from pathlib import Path

import pytest

from observer_fi.cli import progress as told
from observer_fi.cli.commands import COMMANDS, _parser
from observer_fi.cli.options import say
from observer_fi.cli.progress import Stages, progress, share_of
from observer_fi.logs import open_log


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Standard error that is a terminal. Called within a test: pytest puts its own in place before each phase of one."""
    found = Terminal()
    monkeypatch.setattr(sys, "stderr", found)
    monkeypatch.setattr(told, "DELAY_S", 0.05)
    monkeypatch.setattr(told, "TICK_S", 0.02)
    return found


def asked(quiet: bool = False, json: bool = False) -> argparse.Namespace:
    return argparse.Namespace(quiet=quiet, json=json)


def test_a_bar_says_how_long_the_rest_takes_and_lines_stand_above_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = terminal_of(monkeypatch)
    for k in progress(range(6), asked(), 6, "log"):
        time.sleep(0.12)
        say(f"log {k}: no fault")
    said = terminal.getvalue()
    assert "/6 [" in said and "log/s]" in said or "s/log]" in said
    assert capsys.readouterr().out.splitlines() == [f"log {k}: no fault" for k in range(6)]


def test_the_share_of_one_log_says_how_long_the_rest_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with share_of(asked(), "monday", alone=True) as tell:
        for k in range(1, 5):
            time.sleep(0.12)
            tell(0.25 * k)
    assert "monday:  50%" in terminal.getvalue() and " left" in terminal.getvalue()


def test_stages_count_the_seconds_and_leave_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with Stages(asked()) as tell:
        tell("refit of the rig")
        time.sleep(0.3)
    said = terminal.getvalue()
    assert "  refit of the rig: 0 s, 0 s in all" in said and said.endswith("\r\x1b[K")


def test_stages_say_how_long_the_rest_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    with Stages(asked(), {"refit": 0.25, "scores": 0.5}) as tell:
        tell("refit of the rig")
        assert tell.left_s(tell.since + 1.0) is None
        tell.begun -= 10.0
        tell("scores, 0 named so far")
        assert tell.left_s(tell.since + 5.0) == pytest.approx(25.0, abs=0.5)  # of 40 s, 10 and 5 are over
        assert tell.left_s(tell.since + 60.0) == pytest.approx(10.0, abs=0.5)
        time.sleep(0.3)
    assert "about 30 s left" in terminal.getvalue() or "about 31 s left" in terminal.getvalue()


@pytest.mark.parametrize("case", ["quiet", "no terminal", "soon done", "json"])
def test_nothing_is_said_where_nobody_waits(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said: io.StringIO = terminal_of(monkeypatch)
    if case == "no terminal":
        said = io.StringIO()
        monkeypatch.setattr(sys, "stderr", said)
    if case == "soon done":
        monkeypatch.setattr(told, "DELAY_S", 5.0)
    args = asked(case == "quiet", case == "json")
    with Stages(args) as tell:
        tell("refit of the rig")
        time.sleep(0.2)
    if case != "json":  # a bar on the terminal does not disturb what goes to standard output
        list(progress(range(3), args, 3, "log"))
        with share_of(args, "monday", alone=True) as share:
            share(0.5)
    assert said.getvalue().strip("\r ") == ""


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_examples_that_parse(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    examples = COMMANDS[name].examples
    assert 2 <= len(examples) <= 3
    for words, what in examples:
        typed = shlex.split(words.replace("\\\n", " ").split(" < ")[0])
        assert what and _parser(name).parse_args(typed).command == name
    with pytest.raises(SystemExit):
        _parser(name).parse_args([name, "--help"])
    said = capsys.readouterr().out
    assert all(f"observer-fi {words}" in said and f"# {what}" in said for words, what in examples)


def test_a_log_knows_how_much_of_it_was_read(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{1e-3 * k:.3f},0.000000000,0.000000000,0.000000000\n" for k in range(120_000))
    path.write_text("time_s,voltage_v,current_a,position_m\n" + rows)
    file = open_log(path)
    shares = [file.share_read for _ in file.chunks(1000)]
    assert shares == sorted(shares) and 0.0 < shares[0] < 0.6 and shares[-1] == 1.0 == file.share_read
