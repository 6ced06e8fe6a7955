"""Every command killed at random moments: `python tests/kill/kill_commands.py --kills 500`.

Half of the kills of a command fall at any moment from its start on. The others fall where it writes: the command runs up to
there once, and a copy of its process goes on and is killed, over and over. After each kill: files of the user are as they
were, every result that was there before is there and whole, nothing else is half written. At the end each command runs once
more and leaves no left-over.
"""

import argparse
import contextlib
import hashlib
import importlib
import itertools
import json
import os
import random
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from observer_fi.physics import Fault, Move, Scenario, csv_bytes, load_rig, synthesise

ROOT = Path(__file__).parents[2]
PYTHON = [sys.executable, "-m", "observer_fi"]
# What each command leaves, below the working folder.
COMMANDS = {
    "diagnose": (["diagnose", "one/a.csv", "two/a.csv", "--out", "out"], ("out/a/report.json", "out/a_2/report.html")),
    "identify": (["identify", "one/a.csv", "--out", "out"], ("out/a/identify.json", "out/a/identify.html", "out/a/rig.toml")),
    "improve": (["improve", "one/a.csv", "--out", "out"],
                ("out/a/improve.json", "out/a/improve.html", "out/a/extended_rig.toml")),
    "simulate": (["simulate", "--out", "out", "--name", "s"], ("out/s.csv", "out/s.truth.json")),
    "compare": (["compare", "--cases", "2", "--out", "out"], ("out/compare/compare.json", "out/compare/compare.html")),
    "fleet": (["fleet", "logs", "--out", "out", "--workers", "1", "--settings", "settings.toml"],
              ("out/index.html", "out/fleet.parquet", "out/c/report.html")),
    "watch": (["watch"], ("out/watch.jsonl",)),
    "write": (["-"], ("out/w/report.json", "out/w/report.html")),
}  # fmt: skip
# How often a run comes to where it begins to write, and what it calls there: results of logs and summaries, lines.
BEGINNINGS = {"diagnose": 2, "fleet": 5}
CALLED = {"watch": ("observer_fi.serve.watch", "_followed")}
RESULT = ("observer_fi.report.result_folder", "_alone_in")
TURNS = itertools.count()
# Only the writing of results, over and over: a kill hits it almost surely.
WRITER = """
from pathlib import Path
from observer_fi.report import Made, write_result
turn = 0
while True:
    turn += 1
    text = str(turn % 10) * 200_000
    files = {"report.json": '{"text": "%s"}' % text, "report.html": f"<html>{text}</html>", f"{turn % 7}.svg": text}
    write_result(Path("out"), "w", Made("diagnose", {"one/a.csv": ""}), files)
"""


def prepare(folder: Path) -> dict[str, str]:
    """Logs, and files of the user where results will go; {path: hash} of all of them."""
    rig, moves = load_rig(), (Move(0.2, 410.0, 0.5), Move(0.9, -300.0, 0.5))
    for path, fault in (
        ("one/a.csv", Fault()),
        ("two/a.csv", Fault("overload", 1.1)),
        ("logs/b.csv", Fault()),
        ("logs/c.csv", Fault()),
    ):
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_bytes(csv_bytes(synthesise(Scenario(moves, 1.6, fault=fault, seed=3), rig)[0]))
    for path in (
        "out/a/notes.txt",
        "out/a/raw/r.bin",
        "out/c/mine.svg",
        "out/mine.csv",
        "out/compare/mine",
        "out/w/mine",
    ):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(f"mine: {path}")
    return {str(p): digest(p) for p in folder.rglob("*") if p.is_file()}


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def is_whole(path: Path) -> bool:
    """Whether a file ends as its kind does. Raises ValueError for JSON that ends too early."""
    data = path.read_bytes()
    if path.suffix == ".jsonl":
        return all(isinstance(json.loads(line), dict) for line in data.splitlines()) and data[-1:] in (
            b"",
            b"\n",
        )
    if path.suffix == ".json":
        return isinstance(json.loads(data), dict)
    if path.parent.name == "w":  # the writer's own
        return len(data) >= 200_000
    ends = {".html": b"</html>", ".svg": b"</svg>", ".parquet": b"PAR1"}
    return bool(data) and data.rstrip().endswith(ends.get(path.suffix, b""))


def problems(folder: Path, users: dict[str, str], results: set[Path]) -> list[str]:
    """What a kill has broken."""
    found = [
        f"user's {path}"
        for path, was in users.items()
        if not Path(path).is_file() or digest(Path(path)) != was
    ]
    found += [f"lost {path}" for path in results if not path.is_file()]
    for path in (folder / "out").rglob("*"):
        if path.is_file() and str(path) not in users and path.name[0] != ".":
            try:
                found += [] if is_whole(path) else [f"half {path}"]
            except ValueError:
                found.append(f"half {path}")
    return found


def kill_once(name: str, folder: Path, most_s: float, rng: random.Random) -> bool:
    """Start a command, kill it and all it started at a random moment; whether it was still running."""
    if name == "write":
        kill_writer(folder, rng.uniform(0.0, most_s))
        return True
    process = started(name, folder)
    try:
        process.wait(timeout=rng.uniform(0.0, most_s))
        return False
    except subprocess.TimeoutExpired:
        return True
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.wait()


def kill_writer(folder: Path, after_s: float) -> None:
    """A copy of this process that only writes, killed: a start would cost a hundred times as much."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # of forks beside threads: the child only writes files
        child = os.fork()
    if child == 0:
        os.chdir(folder)
        exec(WRITER, {})
    time.sleep(after_s)
    os.kill(child, 9)
    os.waitpid(child, 0)


def started(name: str, folder: Path) -> subprocess.Popen[bytes]:
    """A command under way, its lines in a file where they are its result."""
    prepare_turn(folder)
    with contextlib.ExitStack() as stack:
        ends: tuple[Any, Any] = (subprocess.DEVNULL, subprocess.DEVNULL)
        if name == "watch":
            ends = (
                stack.enter_context((folder / "one/a.csv").open("rb")),
                stack.enter_context((folder / "out/watch.jsonl").open("ab")),
            )
        return subprocess.Popen(
            [*PYTHON, *COMMANDS[name][0]], cwd=folder, stdin=ends[0], stdout=ends[1], stderr=subprocess.DEVNULL,
            start_new_session=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip


def prepare_turn(folder: Path) -> None:
    """Settings that differ from run to run, so that a fleet does its logs anew."""
    (folder / "settings.toml").write_text(f"[decision]\nmove_nats = {30.0 + 1e-6 * next(TURNS):.6f}\n")


def whole_run(name: str, folder: Path) -> float:
    """A command to its end; its time [s]. Raises RuntimeError where it fails."""
    begin = time.monotonic()
    code = started(name, folder).wait()
    if code:
        raise RuntimeError(f"{name} ended with {code}")
    return time.monotonic() - begin


# --- kills while a command writes ----------------------------------------------------------------


def kills_while_writing(
    name: str, folder: Path, kills: int, rng: random.Random, check: Callable[[], list[str]]
) -> tuple[Counter, list[str]]:
    """Copies of a command that were killed between the beginning of their writing and their end, and what is broken."""
    prepare_turn(folder)
    read, write = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os.close(read)
        try:
            _run_with_copies(name, folder, kills, rng, lambda hit: os.write(write, _line(hit, check())))
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    os.close(write)
    with open(read, "rb") as told:
        found = [json.loads(line) for line in told]
    _, status = os.waitpid(child, 0)
    rng.random()  # the child's draws were its own
    broken = [what for _, one in found for what in one]
    if status:
        broken.append("the command that was copied failed")
    return Counter("killed while it wrote" if hit else "ended" for hit, _ in found), broken


def _line(hit: bool, found: list[str]) -> bytes:
    return json.dumps([hit, found]).encode() + b"\n"


def _run_with_copies(
    name: str, folder: Path, kills: int, rng: random.Random, checked: Callable[[bool], object]
) -> None:
    """The command in this process; where it begins to write, copies of the process go on, and are killed."""
    from observer_fi.cli import main

    os.chdir(folder)
    _quiet_ends(name)
    if name == "fleet":
        _in_this_process()
    module, called = CALLED.get(name, RESULT)
    place = importlib.import_module(module)
    real = getattr(place, called)
    left, beginnings = kills, BEGINNINGS.get(name, 1)

    def begins(*given: Any) -> Any:
        nonlocal left, beginnings
        share = -(-left // max(beginnings, 1)) if left else 0
        beginnings, left = beginnings - 1, left - share
        took = 0.0
        for k in range(share + 1 if share else 0):
            begin = time.monotonic()
            copy = os.fork()
            if copy == 0:
                left = 0
                os.setsid()
                _quiet_ends(name)
                return real(*given)
            if k == 0:  # to its end, for the time it takes
                _, status = os.waitpid(copy, 0)
                assert status == 0, status
                took = time.monotonic() - begin
                continue
            time.sleep(rng.uniform(0.0, took if k % 2 else min(took, 0.1)))
            os.kill(copy, 9)
            _, status = os.waitpid(copy, 0)
            checked(os.WIFSIGNALED(status))
        return real(*given)

    setattr(place, called, begins)
    code = main(COMMANDS[name][0])
    if code:
        raise RuntimeError(f"{name} ended with {code}")


def _quiet_ends(name: str) -> None:
    """Standard input and output as `started` has them."""
    for number, path, how in (
        (0, "one/a.csv" if name == "watch" else os.devnull, os.O_RDONLY),
        (1, "out/watch.jsonl" if name == "watch" else os.devnull, os.O_WRONLY | os.O_APPEND),
    ):
        handle = os.open(path, how)
        os.dup2(handle, number)
        os.close(handle)


def _in_this_process() -> None:
    """A fleet without its processes: the same work on each log, one by one."""
    from dataclasses import replace

    from observer_fi.serve import fleet

    def run(job: Any, logs: dict[str, str], *_: object) -> Iterator[dict[str, Any]]:
        job = replace(job, folder=job.folder.resolve(), out=job.out.resolve())
        for log, name in logs.items():
            yield fleet.work(job, log, name)

    fleet.run = run  # type: ignore[assignment]


# --- all of them ---------------------------------------------------------------------------------


def run(kills: int, commands: list[str], seed: int, seconds: float = 1e9) -> tuple[Counter, list[str]]:
    """Kills in turn over the commands: counts, and what was broken."""
    rng, counts, broken = random.Random(seed), Counter(), []
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        users = prepare(folder)
        (folder / "out/watch.jsonl").touch()
        results: set[Path] = set()
        takes = {name: 0.3 if name == "write" else whole_run(name, folder) for name in commands}

        def check() -> list[str]:
            results.update(
                folder / path for n in commands for path in COMMANDS[n][1] if (folder / path).is_file()
            )
            return problems(folder, users, results)

        broken += check()
        writing = {name: 0 if name == "write" else kills // len(commands) // 2 for name in commands}
        for name, share in writing.items():
            if broken or not share:
                continue
            done, found = kills_while_writing(name, folder, share, rng, check)
            counts.update({(name, what): number for what, number in done.items()})
            broken += [f"{name}: {what}" for what in found]
        for _ in range(kills - sum(writing.values())):
            name = _next(commands, counts)
            counts[name, "killed" if kill_once(name, folder, takes[name], rng) else "ended"] += 1
            broken += [f"{name}: {what}" for what in check()]
            if broken or time.monotonic() - begin > seconds:
                break
        for name in commands:
            if name != "write":
                whole_run(name, folder)
        left = [path for path in (folder / "out").rglob(".*.part") if path.parent.name != "w"]
        broken += [f"left over: {path}" for path in left]
        broken += problems(folder, users, results)
    return counts, broken


def _next(commands: list[str], counts: Counter) -> str:
    """The command with the fewest runs so far."""
    return min(commands, key=lambda name: sum(n for (of, _), n in counts.items() if of == name))


def main() -> int:
    """Run, print counts; 1 if anything was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", default=list(COMMANDS), choices=COMMANDS)
    args = parser.parse_args()
    counts, broken = run(args.kills, args.commands, args.seed, args.seconds)
    for (name, what), number in sorted(counts.items()):
        print(f"{number:6} {name} {what}")
    print(f"{sum(counts.values())} runs, {len(broken)} broken")
    for what in broken[:20]:
        print(what)
    return int(bool(broken))


if __name__ == "__main__":
    sys.exit(main())
