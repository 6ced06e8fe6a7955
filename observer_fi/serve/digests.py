"""Digests of many logs, each made once: kept by content of the log and settings, made by local processes or a Dask cluster."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from observer_fi import __version__
from observer_fi.errors import InvalidLogError, UsageError
from observer_fi.logs import PLAIN, SHOWN_SUFFIXES, SUFFIXES, ColumnMap, read_log
from observer_fi.physics import Rig, rig_toml
from observer_fi.report import json_text, write_file
from observer_fi.serve.fleet import digest_of as sha256_of
from observer_fi.serve.fleet import spread
from observer_fi.trend import Digest, digest_of, from_plain, to_plain

KEPT = "digests"  # folder below the output folder
ALONE = 16  # logs that are done sooner than a cluster starts


@dataclass(frozen=True)
class DigestJob:
    """What all logs share: the folder of the digests, the rig and the column map."""

    kept: Path
    rig: Rig
    columns: ColumnMap = PLAIN

    @cached_property
    def settings(self) -> str:
        """Digest of what besides the log a digest depends on."""
        parts = (__version__, rig_toml(self.rig), repr(self.columns))
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    def place(self, sha256: str) -> Path:
        """Where the digest of a log is kept."""
        return self.kept / f"{sha256[:40]}-{self.settings}.json"


def logs_in(places: Sequence[str]) -> list[str]:
    """Log files: those given, and those in the folders given, at any depth, hidden ones aside. Raises UsageError."""
    found: list[str] = []
    for place in places:
        path = Path(place)
        if not path.is_dir():
            found.append(place)
            continue
        inside = sorted(p for p in path.rglob("*") if _is_log(p, path))
        if not inside:
            raise UsageError(f"{place}: no logs ({SHOWN_SUFFIXES}) in this folder or below")
        found += [str(p) for p in inside]
    return list(dict.fromkeys(found))


def _is_log(path: Path, below: Path) -> bool:
    hidden = any(part.startswith(".") for part in path.relative_to(below).parts)
    return not hidden and path.name.lower().endswith(SUFFIXES) and path.is_file()


def digests(
    paths: Sequence[str], job: DigestJob, workers: int = 1, scheduler: str | None = None,
    say: Callable[[str], object] = str,
) -> Iterator[Digest]:  # fmt: skip
    """The digest of each log, in any order; `say` is told of logs that cannot be used, which are left out."""
    todo: list[str] = []
    for path in paths:
        kept = kept_digest(path, job)
        if kept is None:
            todo.append(path)
        else:
            yield kept
    if len(todo) <= ALONE or (workers < 2 and scheduler is None):
        for path in todo:
            yield from _told(make(job, path), say)
        return
    shared = replace(job, kept=job.kept.resolve())
    for path, found in spread(make, shared, {path: (path,) for path in todo}, workers, scheduler):
        yield from _told(f"{path}: {found}" if isinstance(found, Exception) else found, say)


def _told(found: Digest | str, say: Callable[[str], object]) -> Iterator[Digest]:
    if isinstance(found, str):
        say(found)
    else:
        yield found


def kept_digest(path: str, job: DigestJob) -> Digest | None:
    """What an earlier run made of a log of this content, under the path that it has now; None where there is nothing usable."""
    content = sha256_of(Path(path))
    if not content:
        return None
    try:
        found: dict[str, Any] = json.loads(job.place(content).read_text(encoding="utf-8"))
        return replace(from_plain(found), path=path)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def make(job: DigestJob, path: str) -> Digest | str:
    """The digest of one log, kept for the next run; or the one line that says why it cannot be used."""
    try:
        found = digest_of(read_log(path, job.columns), job.rig)
    except InvalidLogError as error:
        return str(error)
    if found.sha256:
        write_file(job.place(found.sha256), json_text(to_plain(found)))
    return found
