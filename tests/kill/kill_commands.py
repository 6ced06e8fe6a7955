"""Every command killed at random moments: `python tests/kill/kill_commands.py --kills 500`.

After each kill: files of the user are as they were, every result that was there before is there and whole, nothing else is
half written. At the end each command runs once more and leaves no left-over.
"""

import argparse
import contextlib
import hashlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

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
    "fleet": (["fleet", "logs", "--out", "out", "--workers", "1"], ("out/index.html", "out/fleet.parquet", "out/c/report.html")),
    "write": (["-"], ("out/w/report.json", "out/w/report.html")),
}  # fmt: skip
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
    process = subprocess.Popen(
        [*PYTHON, *COMMANDS[name][0]], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
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


def whole_run(name: str, folder: Path) -> float:
    """A command to its end; its time [s]."""
    begin = time.monotonic()
    subprocess.run(
        [*PYTHON, *COMMANDS[name][0]],
        cwd=folder,
        check=True,
        capture_output=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    return time.monotonic() - begin


def run(kills: int, commands: list[str], seed: int, seconds: float = 1e9) -> tuple[Counter, list[str]]:
    """Kills in turn over the commands: counts, and what was broken."""
    rng, counts, broken = random.Random(seed), Counter(), []
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        users = prepare(folder)
        results: set[Path] = set()
        takes = {name: 0.3 if name == "write" else whole_run(name, folder) for name in commands}
        for name in commands:
            results |= {folder / path for path in COMMANDS[name][1] if (folder / path).is_file()}
        for k in range(kills):
            name = commands[k % len(commands)]
            counts[name, "killed" if kill_once(name, folder, takes[name], rng) else "ended"] += 1
            results |= {folder / path for path in COMMANDS[name][1] if (folder / path).is_file()}
            broken += [f"{name}: {what}" for what in problems(folder, users, results)]
            if broken or time.monotonic() - begin > seconds:
                break
        for name in commands:
            if name != "write":
                whole_run(name, folder)
        left = [path for path in (folder / "out").rglob(".*.part") if path.parent.name != "w"]
        broken += [f"left over: {path}" for path in left]
        broken += problems(folder, users, results)
    return counts, broken


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
