"""Files and folders that are written whole or not at all: into a temporary neighbour first, then renamed."""

import contextlib
import glob
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from observer_fi.errors import UsageError


def write_file(path: Path, content: str | bytes) -> None:
    """One file. Raises UsageError where the place cannot be written."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    with _usable(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
            Path(name).chmod(0o666 & ~_umask())
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def write_folder(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """A folder that holds exactly these files, whatever an earlier run left there.

    Raises UsageError where the place cannot be written.
    """
    with _usable(folder.parent):
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
        try:
            for name, content in files.items():
                (fresh / name).write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
            fresh.chmod(0o777 & ~_umask())
            _swap(fresh, folder)
        except BaseException:
            shutil.rmtree(fresh, ignore_errors=True)
            raise


def clear_leftovers(folder: Path) -> None:
    """Remove what a process that was killed while it wrote `folder` left beside it. Nobody may be writing it now."""
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.*"):
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)


def _swap(fresh: Path, folder: Path) -> None:
    """The fresh folder takes the name of the old one: its name is free for an instant only."""
    if not folder.exists():
        fresh.rename(folder)
        return
    old = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.old."))
    folder.rename(old / folder.name)
    try:
        fresh.rename(folder)
    except BaseException:
        (old / folder.name).rename(folder)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


@contextlib.contextmanager
def _usable(place: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(
            f"{place}: cannot write there ({reason}); choose another folder with --out"
        ) from error


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current
