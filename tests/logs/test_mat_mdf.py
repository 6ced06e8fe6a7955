"""MAT files of both kinds and MDF files: the same log as from CSV, and one line for what is none."""

import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from asammdf import MDF, Signal
from scenarios import healthy_move
from scipy.io import savemat

from observer_fi.errors import InvalidLogError
from observer_fi.logs.columns import columns_from_table
from observer_fi.logs.ingest import log_name, open_log, read_log

TABLE = healthy_move()
NAMES = ("time_s", "voltage_v", "current_a", "position_m", "pitch_deg", "speed_cmd_rad_s")
CHANNELS = {name: TABLE[:, k] for k, name in enumerate(NAMES)}


def write_hdf5(path: Path, variables: dict[str, object]) -> None:
    """As MATLAB writes version 7.3: a header of 512 bytes, and arrays the other way round."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            if isinstance(value, dict):
                group = file.create_group(name)
                for field, column in value.items():
                    group[field] = np.atleast_2d(column)
            else:
                file[name] = np.atleast_2d(np.asarray(value)).T
    raw = bytearray(path.read_bytes())
    raw[:19] = b"MATLAB 7.3 MAT-file"
    path.write_bytes(bytes(raw))


LAYOUTS: dict[str, Callable[[], dict[str, object]]] = {
    "rows": lambda: {n: v.reshape(1, -1) for n, v in CHANNELS.items()},
    "columns": lambda: {n: v.reshape(-1, 1) for n, v in CHANNELS.items()},
    "with parameters": lambda: {
        **{n: v.reshape(-1, 1) for n, v in CHANNELS.items()},
        "Rm": 20.2,
        "short": np.arange(7.0),
    },
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("write", [savemat, write_hdf5], ids=["v5", "v7.3"])
def test_vectors_of_a_mat_file_are_columns(layout: str, write: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    write(path, LAYOUTS[layout]())
    log = read_log(path)
    assert np.array_equal(log.t, TABLE[:, 0]) and np.array_equal(log.z, TABLE[:, 1:4])
    assert sum(part.t.size for part in open_log(path).chunks(100)) == log.t.size
    if layout == "with parameters":
        assert any("short (7)" in note for note in log.notes) and "Rm: 20.2" in log.metadata


@pytest.mark.parametrize("write", [savemat, write_hdf5], ids=["v5", "v7.3"])
def test_fields_of_a_struct_have_its_name(write: Callable[..., None], tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    write(path, {"run": dict(CHANNELS), "other": np.arange(3.0)})
    column_map = columns_from_table({"columns": {n: f"run.{n}" for n in NAMES}})
    assert np.array_equal(read_log(path, column_map).z, TABLE[:, 1:4])
    with pytest.raises(InvalidLogError, match=r"column time_s is missing; the columns are: run\."):
        read_log(path)


def test_integers_and_single_precision_are_numbers(tmp_path: Path) -> None:
    whole = {n: v.astype(np.float32) for n, v in CHANNELS.items()} | {
        "time_s": np.arange(TABLE.shape[0], dtype=np.int32)
    }
    savemat(tmp_path / "run.mat", whole, do_compression=True)
    log = read_log(tmp_path / "run.mat", columns_from_table({"columns": {"time_s": {"unit": "ms"}}}))
    assert log.rate_hz == pytest.approx(1000.0) and np.allclose(log.z, TABLE[:, 1:4], rtol=1e-6)


def write_mdf(path: Path, *groups: dict[str, np.ndarray], version: str = "4.10") -> Path:
    with MDF(version=version) as file:
        for group in groups:
            given = dict(group)
            t = given.pop("time_s")
            file.append([Signal(v, t, name=n, unit="") for n, v in given.items()], comment="x")
        return Path(file.save(path, overwrite=True))


@pytest.mark.parametrize(("name", "version"), [("run.mf4", "4.10"), ("run.mdf", "3.30")])
def test_an_mdf_file_has_its_time_as_time_s(name: str, version: str, tmp_path: Path) -> None:
    log = read_log(write_mdf(tmp_path / name, CHANNELS, version=version))
    assert np.allclose(log.t, TABLE[:, 0], atol=1e-12) and np.allclose(log.z, TABLE[:, 1:4])
    assert any(line.startswith("start: ") for line in log.metadata)


@pytest.mark.slow
def test_of_several_groups_the_one_with_the_channels_is_read_and_told(tmp_path: Path) -> None:
    slow = {"time_s": np.arange(10.0), "temperature": np.linspace(20.0, 30.0, 10)}
    path = write_mdf(tmp_path / "run.mf4", slow, CHANNELS)
    log = read_log(path)
    assert np.allclose(log.t, TABLE[:, 0]) and any("group 2 of 2 is read" in note for note in log.notes)
    wrong = columns_from_table({"columns": {"pitch_deg": "temperature"}})
    with pytest.raises(
        InvalidLogError, match=r"'temperature' \(pitch_deg\) stands in group 1 \(1 Hz\).*one clock"
    ):
        read_log(path, wrong)


def test_without_asammdf_the_line_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_mdf(tmp_path / "run.mf4", CHANNELS)
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(InvalidLogError, match=r"pip install 'observer-fi\[mdf\]'"):
        read_log(path)


def test_a_reader_that_dies_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_mdf(tmp_path / "run.mf4", CHANNELS)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(
        InvalidLogError, match="not a whole MDF file .asammdf cannot read it.; export or copy it again"
    ):
        read_log(path)


@pytest.mark.parametrize("suffix", ["mat", "73.mat", "mf4", "mdf"])
@pytest.mark.parametrize("spoil", ["cut", "noise", "head", "flipped"])
@pytest.mark.first(6, 11)
def test_a_damaged_file_is_one_line(suffix: str, spoil: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{suffix}"
    if suffix == "mat":
        savemat(path, CHANNELS, do_compression=True)
    elif suffix == "73.mat":
        write_hdf5(path, dict(CHANNELS))
    else:
        write_mdf(path, CHANNELS, version="4.10" if suffix == "mf4" else "3.30")
    raw, rng = bytearray(path.read_bytes()), np.random.default_rng(0)
    if spoil == "flipped":  # in what says where things are
        raw[128:1024] = rng.bytes(1024 - 128)
    new = {"cut": raw[: len(raw) // 3], "noise": rng.bytes(5000), "head": raw[:100], "flipped": raw}[spoil]
    path.write_bytes(bytes(new))
    try:
        log = read_log(path)
    except InvalidLogError as error:
        assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
    else:  # what was flipped may be a comment
        assert spoil == "flipped" and log.t.size == len(TABLE)


def test_a_mat_file_without_vectors_says_what_to_save(tmp_path: Path) -> None:
    savemat(tmp_path / "run.mat", {"a": 1.0, "text": "hello"})
    with pytest.raises(InvalidLogError, match="holds no vectors of numbers"):
        read_log(tmp_path / "run.mat")


def test_names_of_reports_are_without_the_suffix() -> None:
    assert [log_name(f"a/run_1.{s}") for s in ("mat", "mf4", "MDF")] == ["run_1"] * 3
