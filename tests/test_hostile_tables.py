"""Every broken rig file, settings file and column map is refused in one line: by its reader, and by the command."""

import os
import re
from pathlib import Path

import pytest
from hostile_tables import MAPS, RIGS, SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from scenarios import csv_text, healthy_rows

from observer_fi.cli import main
from observer_fi.errors import UsageError
from observer_fi.logs.columns import load_columns
from observer_fi.physics.rigs import load_rig
from observer_fi.settings import load_settings, toml_table

CASES = [
    *((load_rig, text, said) for text, said in RIGS.items()),
    *((load_settings, text, said) for text, said in SETTINGS.items()),
    *((load_columns, text, said) for text, said in MAPS.items()),
]


def names(case: object) -> str:
    return case.__name__ if callable(case) else re.sub(r"[^ -~]", "?", str(case)[-40:])


@pytest.mark.parametrize(("load", "text", "said"), CASES, ids=names)
def test_a_broken_file_is_one_line_with_its_key(load, text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "given.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError) as caught:
        load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.isprintable() and len(message) <= 2000
    assert re.search(said, message), message


@pytest.mark.parametrize("option", ["--rig", "--columns"])
@pytest.mark.parametrize("command", ["diagnose", "identify", "improve"])
def test_a_command_ends_in_that_line_and_with_exit_code_2(
    option: str, command: str, tmp_path: Path, capsys
) -> None:
    (tmp_path / "log.csv").write_text(csv_text(healthy_rows()))
    for text in sorted(RIGS if option == "--rig" else MAPS)[:: 1 if command == "diagnose" else 9]:
        path = tmp_path / "given.toml"
        path.write_text(text, encoding="utf-8")
        assert (
            main([command, str(tmp_path / "log.csv"), option, str(path), "--out", str(tmp_path / "out")]) == 2
        )
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1 and "Traceback" not in err, (text[-60:], err)


@pytest.mark.parametrize("load", [load_rig, load_settings, load_columns])
@pytest.mark.parametrize(
    "path", ["folder.toml", "nowhere.toml", "a\0b.toml", "n" * 300 + ".toml", "pipe.toml", "/dev/zero"]
)
def test_what_is_no_file_is_refused_without_waiting(load, path: str, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.toml").mkdir()
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(UsageError, match="cannot read the"):
        load(path)


def test_bytes_that_are_no_utf_8(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_bytes(b'name = "\xff"')
    with pytest.raises(UsageError, match="not a TOML file"):
        toml_table(tmp_path / "x.toml", "rig file", "data/rigs")


# --- fuzzing: the values of a right file exchanged for any others ----------------------------------

VALUES = st.one_of(
    st.sampled_from(
        ("nan", "inf", "-inf", "true", "''", "[]", "{}", "1e308", "-1", "0", "[[1]]", "2024-05-17", "0x7f")
    ),
    st.floats().map(repr),
    st.integers().map(str),
    st.text(st.characters(codec="utf-8", exclude_characters="'\n\r"), max_size=9).map(lambda t: f"'{t}'"),
)


@pytest.mark.parametrize("kind", ["rig", "settings", "map"])
def test_any_value_anywhere_is_taken_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    load, base = {
        "rig": (load_rig, sorted(RIGS, key=len)[-len(RIGS) // 2 :]),
        "settings": (load_settings, list(SETTINGS)),
        "map": (load_columns, list(MAPS)),
    }[kind]
    texts = [text for text in base if len(text) < 10_000]

    @given(text=st.sampled_from(texts), at=st.integers(0, 200), value=VALUES)
    def check(text: str, at: int, value: str) -> None:
        places = [found.span(1) for found in re.finditer(r"=\s*([^=\s{][^\n,}]*)", text)]
        start, stop = places[at % len(places)] if places else (0, 0)
        path = tmp_path / "given.toml"
        path.write_text(text[:start] + value + text[stop:], encoding="utf-8")
        try:
            load(path)
        except UsageError as error:
            assert str(error).isprintable()

    check()
