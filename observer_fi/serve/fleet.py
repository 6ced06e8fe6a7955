"""A folder of logs, on local processes or a running Dask cluster: one report per log, one summary of all.

What a log's folder holds says for which content, settings and version it was made, so a run goes on where the last one
stopped. Workers write the reports; only rows of the summary travel.
"""

import contextlib
import fnmatch
import hashlib
import json
import math
import os
import secrets
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from observer_fi import __version__
from observer_fi.errors import InvalidLogError, LostClusterError, UsageError
from observer_fi.logs import PLAIN, SHOWN_SUFFIXES, SUFFIXES, ColumnMap
from observer_fi.physics import FAULTS, NOMINAL, NOT_TESTED, Rig, rig_toml
from observer_fi.records import Event, Outcome
from observer_fi.report import (
    Made,
    check_beside,
    clear_leftovers,
    fleet_html,
    folder_name,
    folder_of,
    ours,
    write_beside,
    write_result,
)
from observer_fi.report import diagnosis as report
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose

ENTRY = "fleet.json"  # in a log's folder: what its report was made from, and its row
INDEX, TABLE = "index.html", "fleet.parquet"
TRIES = 3  # workers that may die over one log before it is given up
WAIT_S = 10.0  # for a scheduler to answer, and for its first worker
GONE_S = 60.0  # without any worker, until the run is given up
POLL_S = 0.1
MOST_EVENTS = 200  # faults of one log that the summary lists

Rows = list[dict[str, Any]]

# Column of the summary and its Arrow type.
COLUMNS = {
    "log": "string", "status": "string", "label": "string", "channel": "string", "probability": "double",
    "onset_s": "double", "detected_s": "double", "isolated_s": "double", "moves": "int64", "faulty_moves": "int64",
    "open_loop": "string", "nis_ratio": "double", "samples": "int64", "rate_hz": "double", "duration_s": "double",
    "gaps": "int64", "rejected": "int64", "notes": "int64", "sha256": "string", "report": "string",
    "what": "string", "events": "string", "error": "string",
}  # fmt: skip


@dataclass(frozen=True)
class Job:
    """What all logs of a fleet share. folder: where the logs are; out: where reports go."""

    folder: Path
    out: Path
    rig: Rig
    settings: Settings
    engine: str = "compiled"
    filter_kind: str = "ekf"
    columns: ColumnMap = PLAIN

    @property
    def digest(self) -> str:
        """Of everything besides the log that a report depends on."""
        parts = (
            __version__,
            rig_toml(self.rig),
            asdict(self.settings),
            self.engine,
            self.filter_kind,
            repr(self.columns),
        )
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def find_logs(job: Job, pattern: str = "*", say: Callable[[str], object] = str) -> dict[str, str]:
    """Logs below the folder that match, {path relative to it: name of the report's folder}, in order.

    Hidden files and what lies in the output folder are no logs. `say` is told of folders that cannot be read. A log has the
    same name whatever the pattern. Raises UsageError where there is none.
    """
    if not job.folder.is_dir():
        raise UsageError(f"{job.folder}: no such folder; fleet takes the folder of the logs")
    names: dict[str, str] = {}
    for log in sorted(_logs_below(job, say)):
        stem = (Path(log).parent / folder_name(None, log)).as_posix()
        # two logs of one stem: the later ones keep their suffix; a folder of logs may have a log's name, too
        taken = stem in names.values() or stem in (INDEX, TABLE) or (job.folder / stem).is_dir()
        names[log] = f"{log}.report" if taken else stem
    found = {log: name for log, name in names.items() if fnmatch.fnmatch(Path(log).name, pattern)}
    if not found:
        raise UsageError(f"{job.folder}: no logs ({SHOWN_SUFFIXES}) match {pattern!r} here or below")
    return found


def _logs_below(job: Job, say: Callable[[str], object]) -> Iterator[str]:
    """Relative paths of what looks like a log."""
    out, around = job.out.resolve(), job.folder.resolve()
    inside = out != around and out not in around.parents  # else the logs themselves lie below it

    def unreadable(error: OSError) -> None:
        say(f"{error.filename}: cannot read this folder ({error.strerror}): its logs are left out")

    for folder, below, files in os.walk(job.folder, onerror=unreadable):
        here = Path(folder)
        below[:] = [
            name for name in below if name[0] != "." and not (inside and (here / name).resolve() == out)
        ]
        wanted = [name for name in files if name.lower().endswith(SUFFIXES) and name[0] != "."]
        written = ours(here) if wanted else set()
        yield from (
            (here / name).relative_to(job.folder).as_posix() for name in wanted if name not in written
        )


def made_of(job: Job, command: str, log: str, sha256: str = "") -> Made:
    """What a command's result on one log of the fleet is of."""
    return Made(command, {str(job.folder / log): sha256})


def entry_of(job: Job, log: str, name: str) -> dict[str, Any] | None:
    """What an earlier run left for a log, None where there is nothing usable."""
    place = job.out / name
    folder = folder_of(place.parent, place.name, made_of(job, "fleet", log))
    try:
        entry = json.loads((folder / ENTRY).read_text(encoding="utf-8"))
        return entry if entry["key"] and _whole(job, entry) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _whole(job: Job, entry: dict[str, Any]) -> bool:
    """Whether the report that an entry speaks of is there, and is that one."""
    if entry["row"]["status"] == "bad":
        return True
    page = job.out / entry["row"]["report"]
    return page.is_file() and digest_of(page.with_name("report.json")) == entry["report_sha256"]


def digest_of(path: Path) -> str:
    """SHA-256 of a plain file, "" where there is none that can be read."""
    try:
        if not path.is_file():
            return ""
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def split(job: Job, names: dict[str, str]) -> tuple[Rows, dict[str, str]]:
    """Rows that are up to date, and the logs that have to be read."""
    settings = job.digest

    def current(item: tuple[str, str]) -> dict[str, Any] | None:
        log, name = item
        entry = entry_of(job, log, name)
        if entry is None or entry["settings"] != settings or entry["row"]["log"] != log:
            return None
        content = digest_of(job.folder / log)
        return entry["row"] if content and entry["key"] == content else None

    with ThreadPoolExecutor(4) as pool:  # hashing leaves the interpreter's lock
        rows = dict(zip(names, pool.map(current, names.items()), strict=True))
    done = [row for row in rows.values() if row is not None]
    return done, {log: name for log, name in names.items() if rows[log] is None}


def work(job: Job, log: str, name: str) -> dict[str, Any]:
    """One log to its report, on a worker: the row of the summary. A log that cannot be used is a row with its reason."""
    path = job.folder / log
    if not path.exists():
        raise FileNotFoundError(f"{path} is not there for this worker; logs and reports need a shared folder")
    place = job.out / name
    try:
        outcome = diagnose(
            path, job.rig, job.settings, engine=job.engine, filter_kind=job.filter_kind, columns=job.columns
        )  # fmt: skip
        if outcome.error is not None or outcome.log is None:
            raise InvalidLogError(outcome.error or f"{path}: nothing can be said about it")
    except InvalidLogError as error:
        row = bad_row(log, "bad", str(error), digest_of(path))
    else:
        made = made_of(job, "diagnose", log, outcome.log.sha256)
        outcome = replace(outcome, log=replace(outcome.log, path=log))
        summary = "../" * len(Path(name).parts) + INDEX
        folder = write_result(place.parent, place.name, made, report.files(outcome, job.rig, summary))
        row = row_of(log, folder.relative_to(job.out).as_posix(), outcome)
    made = made_of(job, "fleet", log, row["sha256"])
    write_result(place.parent, place.name, made, {ENTRY: _entry(job, row)})
    return row


def _entry(job: Job, row: dict[str, Any]) -> str:
    written = digest_of((job.out / row["report"]).with_name("report.json")) if row["report"] else ""
    entry = {"key": row["sha256"], "settings": job.digest, "report_sha256": written, "row": row}
    return report.json_text({"schema": "observer-fi/fleet-entry/1", **entry})


def other_rows(job: Job, names: dict[str, str], pattern: str) -> Rows:
    """Rows of logs that this run was not asked for and an earlier one has done."""
    if pattern == "*":
        return []
    others = {log: name for log, name in find_logs(job).items() if log not in names}
    entries = [entry_of(job, log, name) for log, name in others.items()]
    return [entry["row"] for entry in entries if entry is not None]


def bad_row(log: str, status: str, error: str, sha256: str = "") -> dict[str, Any]:
    """The row of a log without a verdict: "bad" will stay so until it changes, "failed" is tried again."""
    return dict.fromkeys(COLUMNS) | {"log": log, "status": status, "error": error, "sha256": sha256}


def not_done(names: Collection[str], rows: Rows, reason: str) -> Rows:
    """Rows of the logs that have none yet."""
    done = {row["log"] for row in rows}
    return [bad_row(log, "failed", f"not done: {reason}") for log in names if log not in done]


def row_of(log: str, name: str, outcome: Outcome) -> dict[str, Any]:
    """The row of a log with a verdict."""
    found = report.report_dict(outcome)
    verdict, fit, facts = found["verdict"], found["consistency"], found["log"]
    nis = fit["nis_mean"]
    faulty = {event["start_s"] for event in found["events"] if event["label"] != "nominal"}
    return dict.fromkeys(COLUMNS) | {
        "log": log, "status": "done", "label": verdict["label"], "channel": verdict["channel"],
        "probability": verdict["probability"], "onset_s": verdict["onset_s"], "detected_s": verdict["detected_s"],
        "isolated_s": verdict["isolated_s"], "moves": len({event["start_s"] for event in found["events"]}),
        "faulty_moves": len(faulty),
        "open_loop": found["open_loop"]["label"], "nis_ratio": None if nis is None else nis / fit["nis_expected"],
        "samples": facts["samples"], "rate_hz": facts["rate_hz"], "duration_s": facts["duration_s"],
        "gaps": facts["gap_count"], "rejected": facts["rejected_count"], "notes": len(facts["notes"]),
        "sha256": facts["sha256"], "report": f"{name}/report.html", "what": _what(outcome),
        "events": json.dumps([_event(e) for e in _faults(outcome)][:MOST_EVENTS], allow_nan=False),
    }  # fmt: skip


def _faults(outcome: Outcome) -> list[Event]:
    """Every fault of a log, in order; a move may have two."""
    events = () if outcome.isolation is None else outcome.isolation.events
    return [one for event in events for one in (event, *event.then) if one.label not in (NOMINAL, NOT_TESTED)]


def _event(event: Event) -> dict[str, Any]:
    """What the summary says of one fault."""
    sizes = {s.name: {"value": s.value, "unit": s.unit} for s in event.severity if math.isfinite(s.value)}
    return {"label": event.label, "channel": event.channel, "probability": event.probability, "onset_s": event.onset_s,
            "severity": sizes}  # fmt: skip


def _what(outcome: Outcome) -> str:
    """Why a log is where it stands in the table: how large its fault is, what else it could be, what changes trust in it."""
    if outcome.isolation is None:
        return ""
    verdict = outcome.isolation.verdict
    said = [s.words for s in verdict.severity]
    said += (
        [f"could as well be {' or '.join(FAULTS[label].title.lower() for label in verdict.alike)}"]
        if verdict.alike
        else []
    )
    said = (
        said
        or list(verdict.reasons)
        or ([] if verdict.label == NOMINAL else [outcome.explanation.partition(". ")[0]])
    )
    few = len(outcome.warnings)
    return "; ".join([*said, *([f"{few} warning{'s' if few > 1 else ''} on its page"] if few else [])])


# --- on a cluster ---


def run(
    job: Job, logs: dict[str, str], workers: int = 2, scheduler: str | None = None
) -> Iterator[dict[str, Any]]:
    """Rows of the logs as they finish. Raises UsageError where there is no dask, or no scheduler.

    What a worker held when it died goes to another one, TRIES times.
    """
    if not logs:
        return
    job = replace(job, folder=job.folder.resolve(), out=job.out.resolve())
    items = {log: (log, name) for log, name in logs.items()}
    for log, row in spread(work, job, items, workers, scheduler):
        yield bad_row(log, "failed", _words(row)) if isinstance(row, Exception) else row
    for name in logs.values():  # a worker that was killed while it wrote could not do it
        clear_leftovers(job.out / name)


def spread(
    function: Callable[..., Any],
    shared: Any,
    items: dict[str, tuple[Any, ...]],
    workers: int,
    scheduler: str | None,
) -> Iterator[tuple[str, Any]]:
    """Names of the items and function(shared, *item) of each, or the error that it ended in, as workers finish them.

    What is shared goes with every item: laid on the workers beforehand it may lie on one of them only, and die with it.
    Raises UsageError where there is no dask, or no scheduler; LostClusterError where the cluster goes on the way.
    """
    with _client(workers, scheduler) as client:
        from dask.distributed import as_completed

        turn = secrets.token_hex(4)  # names of logs need not be text
        futures = {
            client.submit(function, shared, *item, pure=False, key=f"observer-fi-{turn}-{k}", retries=0): name
            for k, (name, item) in enumerate(items.items())
        }
        for future, result in _finished(client, as_completed(list(futures))):
            yield futures.pop(future), result
            future.release()


def _finished(client: Any, under_way: Any) -> Iterator[tuple[Any, Any]]:
    """Futures as they finish, with what they hold. Raises LostClusterError where none will any more.

    A result stays on its worker until it is asked for. Where that one died first another one does the log again,
    which is waited for like any that is not done yet.
    """
    alive = time.monotonic()
    while not under_way.is_empty():
        if under_way.has_ready():
            future = next(under_way)
            try:
                result = _result_of(future)
            except _NotThereError:
                under_way.add(future)
            else:
                yield future, result
                alive = time.monotonic()
                continue
        time.sleep(POLL_S)
        what = _missing(client)
        alive = alive if what else time.monotonic()
        if time.monotonic() - alive > GONE_S:
            raise LostClusterError(what)


class _NotThereError(Exception):
    """A result went with its worker; another one makes it again."""


def _result_of(future: Any) -> Any:
    """What a finished future holds, or its error.

    Raises _NotThereError where it went with its worker, LostClusterError where it went with its cluster.
    """
    if future.status == "cancelled":
        raise LostClusterError("the scheduler is gone")
    if future.status in ("lost", "pending"):
        raise _NotThereError
    try:
        return future.exception(timeout=GONE_S) or future.result(timeout=GONE_S)
    except TimeoutError as late:
        raise _NotThereError from late
    except (CancelledError, OSError) as gone:
        raise LostClusterError("the cluster is gone") from gone
    except Exception as error:  # its second try ended in one
        return error


def _missing(client: Any) -> str:
    """What a cluster lacks to go on, "" where it lacks nothing. Raises LostClusterError where its scheduler is gone.

    A scheduler may be slow to answer: it imports what workers run.
    """
    try:
        if client.status != "running":
            raise LostClusterError("the scheduler is gone")
        workers = client.sync(client.scheduler.ncores, callback_timeout=WAIT_S)
        return "" if workers else "the last worker is gone"
    except TimeoutError:
        return "the scheduler does not answer"
    except (OSError, ValueError) as error:
        raise LostClusterError("the scheduler is gone") from error


def _words(error: BaseException) -> str:
    from dask.distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return f"{TRIES} workers died over it; look at their memory, or diagnose it alone"
    return f"{type(error).__name__}: {error}"


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    try:
        import dask
        from dask.distributed import Client, LocalCluster
    except ImportError as error:
        raise UsageError("fleet needs dask: pip install 'observer-fi[fleet]'") from error
    quiet = {"distributed.scheduler.allowed-failures": TRIES - 1, "distributed.comm.timeouts.connect": WAIT_S}
    with dask.config.set(quiet), contextlib.ExitStack() as stack:
        if scheduler is None:
            scheduler = stack.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address=":0",
                    silence_logs="CRITICAL",
                )  # fmt: skip
            )
        try:
            client = stack.enter_context(Client(scheduler, timeout=WAIT_S))
            client.wait_for_workers(1, timeout=WAIT_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise UsageError(
                f"--scheduler {scheduler}: no scheduler with a worker answers there; give its address as tcp://host:8786"
            ) from error
        _check_versions(client)
        yield client


def _version() -> str:
    return __version__


def _check_versions(client: Any) -> None:
    try:
        found = set(client.run(_version).values())
    except (ImportError, AttributeError) as error:
        raise UsageError(
            f"the workers cannot import observer-fi {__version__}: install it there ({error})"
        ) from error
    if found != {__version__}:
        raise UsageError(
            f"the workers run observer-fi {', '.join(sorted(found))}, this is {__version__}: install the same"
        )


# --- the summary ---


def worst_first(rows: Rows) -> Rows:
    """Faults by kind and certainty, then what could not be judged, then healthy logs with the worst fit in front."""

    def key(row: dict[str, Any]) -> tuple[Any, ...]:
        if row["status"] != "done" or row["label"] == NOT_TESTED:
            return 1, 0, 0.0, row["log"]
        if row["label"] != "nominal":
            return 0, FAULTS[row["label"]].rank, -row["probability"], row["log"]
        ratio = row["nis_ratio"]
        return 2, 0, -(ratio if ratio is not None and math.isfinite(ratio) else 0.0), row["log"]

    return sorted(rows, key=key)


def write_summary(job: Job, rows: Rows) -> None:
    """fleet.parquet and index.html of all logs, worst first."""
    rows = worst_first(rows)
    write_beside(job.out, _summary_of(job), {TABLE: parquet(rows), INDEX: page(job, rows)})


def check_summary(job: Job) -> None:
    """Raises UsageError where the summary would replace what is not this fleet's."""
    check_beside(job.out, _summary_of(job), (TABLE, INDEX))


def _summary_of(job: Job) -> Made:
    return Made("fleet", {str(job.folder.resolve()): ""})


def parquet(rows: Rows) -> bytes:
    """The rows as a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [(name, getattr(pa, {"double": "float64"}.get(kind, kind))()) for name, kind in COLUMNS.items()]
    )
    sink = pa.BufferOutputStream()
    plain = [{key: _text(value) for key, value in row.items()} for row in rows]
    pq.write_table(pa.Table.from_pylist(plain, schema=schema), sink)
    return bytes(sink.getvalue())


def _text(value: Any) -> Any:
    """A text that any reader takes: what a file name holds that is no UTF-8 as an escape."""
    return value.encode("utf-8", "backslashreplace").decode("utf-8") if isinstance(value, str) else value


def counts(rows: Rows) -> dict[str, int]:
    """How many logs have which verdict, or none."""
    found: dict[str, int] = {}
    for row in worst_first(rows):
        what = row["label"] if row["status"] == "done" else row["status"]
        found[what] = found.get(what, 0) + 1
    return found


def page(job: Job, rows: Rows) -> str:
    """index.html: one file, no network, the same bytes for the same logs and the same trend pages beside it."""
    return fleet_html(job.folder.name or str(job.folder), job.rig, rows, _trends(job))


def _trends(job: Job) -> dict[str, str]:
    """The pages of `trend` below the output folder, {name: link}."""
    if not job.out.is_dir():
        return {}
    found = sorted(place.name for place in job.out.iterdir() if "trend.html" in ours(place))
    return {
        name: f"{quote(os.fsencode(name))}/trend.html"
        for name in found
        if (job.out / name / "trend.html").is_file()
    }


def headline(rows: Rows, new: int) -> str:
    """The fleet in one line."""
    parts = [f"{number} {what.replace('_', ' ')}" for what, number in counts(rows).items()]
    return f"{len(rows)} logs: {', '.join(parts)}; {new} read now, {len(rows) - new} as they were"


def problems(rows: Sequence[dict[str, Any]]) -> list[str]:
    """One line per log that has no verdict."""
    return [
        f"{row['error']}" if row["status"] == "bad" else f"{row['log']}: {row['error']}"
        for row in rows
        if row["error"]
    ]
