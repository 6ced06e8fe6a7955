"""Results on disk: written whole or not at all, and in place of nothing but what this project wrote itself.

A folder of results carries a marker that lists, for each command, the logs a result was made from and the files it consists
of, with their hashes. A file that has changed since, or that the marker does not list, is somebody else's and stays.
"""

import contextlib
import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from observer_fi.errors import UsageError
from observer_fi.logs import log_name

MARKER = ".observer-fi.json"
SCHEMA = "observer-fi/folder/1"
PART = ".observer-fi.{}.part"  # a file of a result under way: what a killed run left of them is cleared by the next one
LONGEST_NAME = 255  # bytes of a file name

Files = Mapping[str, str | bytes]


class Made(NamedTuple):
    """What a result is of: the command, and its logs as {path: SHA-256, or "" where it is not known}.

    grows: whether it stays the same result when logs are added, as a life does.
    """

    command: str
    logs: Mapping[str, str]
    grows: bool = False


# --- files ---------------------------------------------------------------------------------------


def write_file(path: Path, content: str | bytes) -> None:
    """One file, in place of whatever has its name. Raises UsageError where the place cannot be written."""
    with _usable(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        part = _part(path.parent, _bytes(content), f".{path.name[:40]}.{{}}.new")
        try:
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise


def write_folder(folder: Path, files: Files) -> None:
    """These files, each whole, in place of those of the same names; nothing else in the folder is touched."""
    data = {name: _bytes(content) for name, content in files.items()}
    for name, content in data.items():
        write_file(folder / name, content)


def _bytes(content: str | bytes) -> bytes:
    """UTF-8; what a file name holds that is no UTF-8 as an escape, which JSON reads back."""
    return content if isinstance(content, bytes) else content.encode("utf-8", "backslashreplace")


def _part(folder: Path, data: bytes, pattern: str = PART) -> Path:
    """A new file in the folder, on the disk before it gets its name."""
    part = folder / pattern.format(secrets.token_hex(6))
    try:
        with part.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part


# --- results -------------------------------------------------------------------------------------


def write_result(out: Path, name: str, made: Made, files: Files) -> Path:
    """The files of a result into the folder `name` below `out`; returns the folder, which has a number behind its name
    where `name` is another log's, or where the files would replace what is not ours.

    Raises UsageError where the place cannot be written.
    """
    checked_name(name)
    data = {file: _bytes(content) for file, content in files.items()}
    with _usable(out):
        out.mkdir(parents=True, exist_ok=True)
        with _alone_in(out):
            folder = folder_of(out, name, made, tuple(data))
            folder.mkdir(exist_ok=True)
            try:
                _replace(folder, made, data)
            except BaseException:
                with contextlib.suppress(OSError):
                    folder.rmdir()  # empty, where nothing was there before
                raise
    return folder


def write_beside(out: Path, made: Made, files: Files) -> None:
    """The files of a result into `out` itself, beside whatever is there.

    Raises UsageError where the place cannot be written, or a file of that name is not ours.
    """
    data = {file: _bytes(content) for file, content in files.items()}
    with _usable(out):
        out.mkdir(parents=True, exist_ok=True)
        with _alone_in(out):
            check_beside(out, made, tuple(data))
            _replace(out, made, data, takes_back=False)


def check_beside(out: Path, made: Made, files: tuple[str, ...]) -> None:
    """Raises UsageError where `write_beside` would have to replace what is not this result's."""
    with _usable(out):
        results = _results(out)
        if not _same(results.get(made.command), made):
            raise UsageError(
                f"{out}: holds the {made.command} of {' '.join(results[made.command]['logs'])}; choose another "
                "folder with --out"
            )
        for file in _foreign(out, results.get(made.command), files):
            raise UsageError(
                f"{out / file}: this file was not written by observer-fi, or was changed since; move it, or "
                "choose another name or folder (--out)"
            )


def folder_of(out: Path, name: str, made: Made, files: tuple[str, ...] = ()) -> Path:
    """The folder below `out` that holds this result, or would take it: `name`, or the same with a number."""
    free = None
    number = 1
    while True:
        folder = out / _numbered(name, number)
        there = os.path.lexists(folder)
        results = _results(folder) if there else {}
        if made.command in results and _fits(folder, results, made, files):
            return folder
        if free is None and (not there or _fits(folder, results, made, files)):
            free = folder
        if not there and free is not None:
            return free
        number += 1


def clear_leftovers(folder: Path) -> None:
    """Remove what a process that was killed while it wrote a result left in its folder."""
    if not folder.is_dir():
        return
    with _usable(folder), _alone_in(folder.parent):
        _clear(folder)
        with contextlib.suppress(OSError):
            folder.rmdir()  # if it is empty


def _numbered(name: str, number: int) -> str:
    """A folder name, with a number from the second on, cut to what a file system takes."""
    suffix = "" if number == 1 else f"_{number}"
    while len(os.fsencode(name)) + len(suffix) > LONGEST_NAME:
        name = name[:-1]
    return name + suffix


def _fits(folder: Path, results: dict[str, Any], made: Made, files: tuple[str, ...]) -> bool:
    """Whether a result may go into a folder that exists: it is of the same log, and every file it replaces is its own."""
    if not folder.is_dir() or not _same(results.get(made.command), made):
        return False
    beside = {next(iter(entry["logs"]), None) for entry in results.values()} - {None}
    first = next((_place(path) for path in made.logs), None)
    if first and made.command not in results and beside - {first}:
        return False
    return not list(_foreign(folder, results.get(made.command), files))


def _same(entry: dict[str, Any] | None, made: Made) -> bool:
    """Whether an earlier result, if any, was of the same logs: the same paths, or the same bytes where they were moved."""
    if entry is None:
        return True
    before, now = entry["logs"], {_place(path): digest for path, digest in made.logs.items()}
    if set(before) == set(now) or (made.grows and set(before) < set(now)):
        return True
    moved = not any(os.path.lexists(path) for path in before)
    return moved and sorted(before.values()) == sorted(now.values())


def _place(path: str) -> str:
    """Where a log lies, by whatever links its folder was reached."""
    return os.path.join(os.path.realpath(os.path.dirname(path)), os.path.basename(path))


def ours(folder: Path) -> set[str]:
    """Names of the files in a folder that this project wrote."""
    return {MARKER, *(file for entry in _results(folder).values() for file in entry["files"])}


def reports_below(out: Path, logs: Sequence[str]) -> dict[str, str]:
    """Links from a result's folder below `out` to the diagnoses of these logs that stand below `out`, by the log's path."""
    found: dict[str, str] = {}
    for marker in sorted(out.rglob(MARKER)) if out.is_dir() else ():
        of = _results(marker.parent).get("diagnose", {"logs": {}})["logs"]
        if (marker.parent / "report.html").is_file():
            link = quote(os.fsencode(marker.parent.relative_to(out).as_posix()))
            found |= dict.fromkeys(of, f"../{link}/report.html")
    return {path: found[_place(path)] for path in logs if _place(path) in found}


def _foreign(folder: Path, entry: dict[str, Any] | None, files: tuple[str, ...]) -> Iterator[str]:
    """Those of the files that exist and are not as this result's last run wrote them."""
    known = entry["files"] if entry else {}
    for file in files:
        path = folder / file
        if os.path.lexists(path) and _digest(path) not in known.get(file, ()):
            yield file


def _replace(folder: Path, made: Made, data: dict[str, bytes], takes_back: bool = True) -> None:
    """The new files in place of the old ones. The marker knows both as ours while they change places.

    takes_back: whether files of the old result that the new one does not have go.
    """
    _clear(folder)
    results = _results(folder)
    old = results.get(made.command, {"files": {}})["files"]
    new = {file: [hashlib.sha256(content).hexdigest()] for file, content in data.items()}
    stay = {} if takes_back else {file: known for file, known in old.items() if file not in new}
    entry = {"logs": {_place(path): digest for path, digest in made.logs.items()}, "files": stay | new}
    parts: dict[str, Path] = {}
    try:
        for file, content in data.items():
            parts[file] = _part(folder, content)
        both = {file: [*old.get(file, ()), *new.get(file, ())] for file in {**old, **new}}
        _mark(folder, results | {made.command: entry | {"files": both}})
        for file, part in parts.items():
            part.replace(folder / file)
    except BaseException:
        for part in parts.values():
            part.unlink(missing_ok=True)
        raise
    for file in old.keys() - new.keys() - stay.keys():
        if _digest(folder / file) in old[file]:
            (folder / file).unlink()
    _mark(folder, results | {made.command: entry})
    _settle(folder)


def _mark(folder: Path, results: dict[str, Any]) -> None:
    text = json.dumps({"schema": SCHEMA, "results": results}, indent=1)
    _part(folder, text.encode()).replace(folder / MARKER)


def _results(folder: Path) -> dict[str, Any]:
    """What the marker of a folder lists, {command: {"logs": ..., "files": ...}}; nothing where there is no marker of ours."""
    try:
        found = json.loads((folder / MARKER).read_bytes())
        results = found["results"] if found["schema"] == SCHEMA else {}
        whole = all(
            isinstance(entry["logs"], dict) and isinstance(entry["files"], dict) for entry in results.values()
        )
        return dict(results) if whole else {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _digest(path: Path) -> str:
    """SHA-256 of a plain file, "" for anything else."""
    if path.is_symlink() or not path.is_file():
        return ""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _clear(folder: Path) -> None:
    for left in folder.glob(PART.format("*")):
        left.unlink(missing_ok=True)


def _settle(folder: Path) -> None:
    """The new names on the disk, where the system lets a folder be opened."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def _alone_in(out: Path) -> Iterator[None]:
    """No other process of this project writes below `out` meanwhile, where the file system knows locks."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            handle = os.open(out, os.O_RDONLY)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def _usable(place: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(
            f"{place}: cannot write there ({reason}); choose another folder with --out"
        ) from error


# --- names ---------------------------------------------------------------------------------------


def folder_name(name: str | None, log: str) -> str:
    """The folder of a log's result: `name` if it was asked for, else the log's own, "log" where that is no name.

    Raises UsageError for a name that leads elsewhere.
    """
    if name is not None:
        return checked_name(name)
    stem = "".join("_" if _leads_elsewhere(c) else c for c in log_name(log))
    return stem if stem.strip(". ") else "log"


def checked_name(name: str) -> str:
    """A name that a person chose for a file or folder. Raises UsageError where it leads elsewhere or is none."""
    if not name.strip(". ") or any(map(_leads_elsewhere, name)) or len(os.fsencode(name)) > LONGEST_NAME:
        raise UsageError(
            f"--name {name[:80]!r}: not a name for a file; take letters, digits, '-', '_' and '.', no path"
        )
    return name


def _leads_elsewhere(character: str) -> bool:
    return character in "/\\" or ord(character) < 32 or ord(character) == 127
