"""A folder of logs, on local processes or a running Dask cluster: one report per log, one summary of all.

What a log's folder holds says for which content, settings and version it was made, so a run goes on where the last one
stopped. Workers write the reports; only rows of the summary travel.
"""

import contextlib
import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from observer_fi import __version__
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs import PLAIN, SUFFIXES, ColumnMap, log_name
from observer_fi.physics import FAULTS, Rig, colour_of, rig_toml
from observer_fi.records import Outcome
from observer_fi.report import clear_leftovers, write_file, write_folder
from observer_fi.report import diagnosis as report
from observer_fi.settings import Settings
from observer_fi.verdict import diagnose

ENTRY = "fleet.json"  # in a log's folder: what its report was made from, and its row
INDEX, TABLE = "index.html", "fleet.parquet"
TRIES = 3  # workers that may die over one log before it is given up
WAIT_S = 10.0  # for a scheduler to answer, and for its first worker

Rows = list[dict[str, Any]]

# Column of the summary and its Arrow type.
COLUMNS = {
    "log": "string", "status": "string", "label": "string", "channel": "string", "probability": "double",
    "onset_s": "double", "detected_s": "double", "isolated_s": "double", "moves": "int64", "faulty_moves": "int64",
    "open_loop": "string", "nis_ratio": "double", "samples": "int64", "rate_hz": "double", "duration_s": "double",
    "gaps": "int64", "rejected": "int64", "notes": "int64", "sha256": "string", "report": "string",
    "error": "string",
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


def find_logs(job: Job, pattern: str = "*") -> dict[str, str]:
    """Logs below the folder, {path relative to it: name of the report's folder}, in order.

    Hidden files and what lies in the output folder are no logs. Raises UsageError where there is none.
    """
    if not job.folder.is_dir():
        raise UsageError(f"{job.folder}: no such folder; fleet takes the folder of the logs")
    own = job.out.resolve()
    found = []
    for path in job.folder.rglob(pattern):
        relative = path.relative_to(job.folder)
        hidden = any(part.startswith(".") for part in relative.parts)
        if (
            path.name.lower().endswith(SUFFIXES)
            and not hidden
            and own not in path.resolve().parents
            and path.is_file()
        ):
            found.append(relative.as_posix())
    if not found:
        raise UsageError(f"{job.folder}: no logs ({', '.join(SUFFIXES)}) match {pattern!r} here or below")
    names: dict[str, str] = {}
    for log in sorted(found):
        stem = (Path(log).parent / log_name(log)).as_posix()
        # two logs of one stem: the later ones keep their suffix; a folder of logs may have a log's name, too
        names[log] = (
            stem if stem not in names.values() and not (job.folder / stem).is_dir() else f"{log}.report"
        )
    return names


def entry_of(job: Job, name: str) -> dict[str, Any] | None:
    """What an earlier run left for a log, None where there is nothing usable."""
    folder = job.out / name
    try:
        entry = json.loads((folder / ENTRY).read_text(encoding="utf-8"))
        whole = entry["row"]["status"] == "bad" or (folder / "report.html").is_file()
        return entry if whole and entry["key"] else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def digest_of(path: Path) -> str:
    """SHA-256 of a file, "" where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return ""


def split(job: Job, names: dict[str, str]) -> tuple[Rows, dict[str, str]]:
    """Rows that are up to date, and the logs that have to be read."""
    settings = job.digest

    def current(item: tuple[str, str]) -> dict[str, Any] | None:
        log, name = item
        entry = entry_of(job, name)
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
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there for this worker; logs and reports need a shared folder")
    folder = job.out / name
    try:
        outcome = diagnose(
            path, job.rig, job.settings, engine=job.engine, filter_kind=job.filter_kind, columns=job.columns
        )  # fmt: skip
        if outcome.error is not None or outcome.log is None:
            raise InvalidLogError(outcome.error or f"{path}: nothing can be said about it")
    except InvalidLogError as error:
        row = bad_row(log, "bad", str(error), digest_of(path))
        write_folder(folder, {ENTRY: _entry(job, row)})
        return row
    row = row_of(log, name, outcome)
    outcome = replace(outcome, log=replace(outcome.log, path=log))
    write_folder(folder, {**report.files(outcome, job.rig), ENTRY: _entry(job, row)})
    return row


def _entry(job: Job, row: dict[str, Any]) -> str:
    return report.json_text(
        {"schema": "observer-fi/fleet-entry/1", "key": row["sha256"], "settings": job.digest, "row": row}
    )


def bad_row(log: str, status: str, error: str, sha256: str = "") -> dict[str, Any]:
    """The row of a log without a verdict: "bad" will stay so until it changes, "failed" is tried again."""
    return dict.fromkeys(COLUMNS) | {"log": log, "status": status, "error": error, "sha256": sha256}


def row_of(log: str, name: str, outcome: Outcome) -> dict[str, Any]:
    """The row of a log with a verdict."""
    found = report.report_dict(outcome)
    verdict, fit, facts = found["verdict"], found["consistency"], found["log"]
    nis = fit["nis_mean"]
    return dict.fromkeys(COLUMNS) | {
        "log": log, "status": "done", "label": verdict["label"], "channel": verdict["channel"],
        "probability": verdict["probability"], "onset_s": verdict["onset_s"], "detected_s": verdict["detected_s"],
        "isolated_s": verdict["isolated_s"], "moves": len(found["events"]),
        "faulty_moves": sum(event["label"] != "nominal" for event in found["events"]),
        "open_loop": found["open_loop"]["label"], "nis_ratio": None if nis is None else nis / fit["nis_expected"],
        "samples": facts["samples"], "rate_hz": facts["rate_hz"], "duration_s": facts["duration_s"],
        "gaps": facts["gap_count"], "rejected": facts["rejected_count"], "notes": len(facts["notes"]),
        "sha256": facts["sha256"], "report": f"{name}/report.html",
    }  # fmt: skip


# --- on a cluster ---


def run(
    job: Job, logs: dict[str, str], workers: int = 2, scheduler: str | None = None
) -> Iterator[dict[str, Any]]:
    """Rows of the logs as they finish. Raises UsageError where there is no dask, or no scheduler.

    What a worker held when it died goes to another one, TRIES times.
    """
    if not logs:
        return
    with _client(workers, scheduler) as client:
        from dask.distributed import as_completed

        job = replace(job, folder=job.folder.resolve(), out=job.out.resolve())
        shared = client.scatter(job, broadcast=True, hash=False)
        futures = {
            client.submit(work, shared, log, name, pure=False, key=f"observer-fi-{k}-{log}", retries=0): log
            for k, (log, name) in enumerate(logs.items())
        }
        for future in as_completed(list(futures)):
            log = futures.pop(future)
            error = future.exception()
            yield future.result() if error is None else bad_row(log, "failed", _words(error))
            future.release()
    for name in logs.values():  # a worker that was killed while it wrote could not do it
        clear_leftovers(job.out / name)


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
        if row["status"] != "done":
            return 1, 0, 0.0, row["log"]
        if row["label"] != "nominal":
            return 0, FAULTS[row["label"]].rank, -row["probability"], row["log"]
        ratio = row["nis_ratio"]
        return 2, 0, -(ratio if ratio is not None and math.isfinite(ratio) else 0.0), row["log"]

    return sorted(rows, key=key)


def write_summary(job: Job, rows: Rows) -> None:
    """fleet.parquet and index.html of all logs, worst first."""
    rows = worst_first(rows)
    write_file(job.out / TABLE, parquet(rows))
    write_file(job.out / INDEX, page(job, rows))


def parquet(rows: Rows) -> bytes:
    """The rows as a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [(name, getattr(pa, {"double": "float64"}.get(kind, kind))()) for name, kind in COLUMNS.items()]
    )
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), sink)
    return bytes(sink.getvalue())


def counts(rows: Rows) -> dict[str, int]:
    """How many logs have which verdict, or none."""
    found: dict[str, int] = {}
    for row in worst_first(rows):
        what = row["label"] if row["status"] == "done" else row["status"]
        found[what] = found.get(what, 0) + 1
    return found


def page(job: Job, rows: Rows) -> str:
    """index.html: one file, no network, the same bytes for the same logs."""
    from urllib.parse import quote

    return (
        report.environment()
        .get_template("fleet.html")
        .render(
            rows=rows,
            counts=counts(rows),
            names=report.NAMES | {"bad": "Not readable", "failed": "Not done"},
            folder=job.folder.name or str(job.folder),
            rig=job.rig,
            colour_of=colour_of,
            link=quote,
            versions=report.versions(),
        )
    )


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
