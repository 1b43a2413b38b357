"""Reading what may be no file at all."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import pytest

from slipstream.config import MAX_TOML_BYTES, Settings, check, read_data, read_toml
from slipstream.errors import InputError
from slipstream.files import open_unpacked, read_file, silent_libraries


def test_only_regular_files_of_bounded_size_are_read(tmp_path: Path) -> None:
    """A pipe, a directory, a device and what is too large are refused, each in its words."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"12345")
    for path, problem in (
        (tmp_path / "pipe", "a pipe, device or socket, no regular file"),
        (tmp_path, "is a directory"),
        (Path("/dev/zero"), "a pipe, device or socket, no regular file"),
        (tmp_path / "none", "no such file"),
        (tmp_path / "a\0b", "not a path"),
        (tmp_path / "file", "larger than 4e-06 MB"),
    ):
        with pytest.raises(InputError) as refused:
            read_file(path, 4)
        assert refused.value.problem == problem
    assert read_file(tmp_path / "file", 5) == b"12345"


def test_what_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    """In the middle of reading, before it fills the memory."""
    path = tmp_path / "packed"
    path.write_bytes(gzip.compress(bytes(1_000_000)))
    with open_unpacked(path, 1_000_000) as file:
        assert len(file.read()) == 1_000_000
    with open_unpacked(path, 900_000) as file:
        assert len(file.read(900_000)) == 900_000
        with pytest.raises(InputError, match="larger than"):
            file.read(1)
    path.write_bytes(b"plain")
    with open_unpacked(path, 5) as file:
        assert file.read(3) + file.read() == b"plain"


def test_libraries_say_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    """Only while it lasts."""
    with silent_libraries():
        os.write(2, b"libpng error\n")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"


def test_a_files_words_do_not_steer_the_terminal() -> None:
    """Control characters are shown as what they are, and long ones are cut."""
    line = str(
        InputError("a.toml", "unknown \x1b[2J key\0" + "x" * 9999, "remove it", key="\u202e")
    )
    assert "\\x1b[2J key\\x00" in line
    assert "\\u202e" in line
    assert len(line) < 1000
    assert line.endswith("...; remove it")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a" + ".a" * 3000 + " = 1", "a key of more than 50 parts"),
        ('"a b"' + '."a b"' * 3000 + " = 1", "a key of more than 50 parts"),
        ("a = '" + "a." * 3000 + '\'\nb = """' + "a." * 99 + '"""  # ' + "a." * 99, None),
        ("a = " + "9" * 6000, "Exceeds the limit"),
        ("a = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("# " + "x" * MAX_TOML_BYTES, "larger than"),
    ],
)
def test_toml_that_would_take_for_ever_is_refused(
    tmp_path: Path, text: str, problem: str | None
) -> None:
    """Long keys, numbers, nests and files; what looks like a key in a string or comment is none."""
    path = tmp_path / "a.toml"
    path.write_text(text)
    if problem is None:
        assert set(read_toml(path)) == {"a", "b"}
        return
    with pytest.raises(InputError, match=problem):
        read_toml(path)


def test_json_of_a_million_lists_is_refused(tmp_path: Path) -> None:
    """Each costs more than its two bytes."""
    path = tmp_path / "a.json"
    path.write_text("[" + "[]," * 1_000_000 + "[]]")
    with pytest.raises(InputError, match="more than 500000 lists and objects"):
        read_data(path)


class Rows(Settings):
    """A table of rows."""

    rows: tuple[int, ...]
    name: str = ""


def test_the_first_faulty_row_is_told_and_the_others_cost_nothing() -> None:
    """Like all others it names its key."""
    with pytest.raises(InputError) as refused:
        check({"rows": [1, "x", *["y"] * 100_000]}, Rows, "a.toml")
    assert refused.value.key == "rows.1"


@pytest.mark.parametrize(
    "data",
    [{"rows": [], "name": "a\0b"}, {"rows": [int("f" * 20_000, 16)]}],
)
def test_what_json_cannot_say_is_refused(data: dict[str, object]) -> None:
    """NUL characters, which no path may hold, and numbers that TOML gives in hexadecimal."""
    with pytest.raises(InputError):
        check(data, Rows, "a.toml")
    assert check({"rows": [], "name": "a\\u0000b"}, Rows, "a.toml").name == "a\\u0000b"
