"""Reading what may be no file at all."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import pytest

from slipstream.config import (
    Settings,
    check,
    parse_json,
    read_data,
    read_secret,
)
from slipstream.errors import InputError
from slipstream.files import open_unpacked, read_file, silent_libraries


def test_what_is_no_file_or_too_large_is_refused(tmp_path: Path) -> None:
    """Each in its words."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"12345")
    for path, problem in (
        (tmp_path / "pipe", "no regular file"),
        (tmp_path, "is a directory"),
        (tmp_path / "none", "no such file"),
        (tmp_path / "file", "larger than 4e-06 MB"),
    ):
        with pytest.raises(InputError) as refused:
            read_file(path, 4)
        assert refused.value.problem == problem
    assert read_file(tmp_path / "file", 5) == b"12345"


def test_a_packed_file_is_read_as_a_plain_one(tmp_path: Path) -> None:
    """Packed with gzip, by its content."""
    path = tmp_path / "file"
    for data in (gzip.compress(b"plain"), b"plain"):
        path.write_bytes(data)
        with open_unpacked(path) as file:
            assert file.read() == b"plain"
    with (
        pytest.raises(InputError, match="no such file; give one"),
        open_unpacked(tmp_path / "none", "give one"),
    ):
        pass


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.toml", 'name = "Kö"\n[of]\nn = 1\n'),
        ("A.TOML", 'name = "Kö"\nof.n = 1\n'),
        ("a.json", '{"name": "Kö",\n"of": {"n": 1}}\n'),
        ("A.JSON", '{"name": "Kö",\n"of": {"n": 1}}\n'),
    ],
)
def test_every_editors_file_is_read_alike(name: str, text: str, tmp_path: Path) -> None:
    """With and without a byte order mark, lines ending as on any system, the name in capitals."""
    path = tmp_path / name
    for mark in ("", "\ufeff"):
        for end in ("\n", "\r\n", "\r"):
            path.write_bytes((mark + text).replace("\n", end).encode())
            assert read_data(path) == {"name": "Kö", "of": {"n": 1}}
    path.write_bytes(b"\xef\xbb\xbfhunter2\r\n")
    assert read_secret(path) == "hunter2"


@pytest.mark.parametrize(
    ("encoding", "problem"),
    [
        ("utf-16", "not {}: encoded in UTF-16 or UTF-32"),
        ("utf-16-le", "not {}: encoded in UTF-16 or UTF-32"),
        ("utf-16-be", "not {}: encoded in UTF-16 or UTF-32"),
        ("utf-32", "not {}: encoded in UTF-16 or UTF-32"),
        ("latin-1", "line 2: not {}: not UTF-8"),
    ],
)
def test_another_encoding_is_told_in_one_line(encoding: str, problem: str, tmp_path: Path) -> None:
    """With the file and the mend, whatever is in it; what is no file is named by its source."""
    for form in ("TOML", "JSON"):
        path = tmp_path / f"a.{form}"
        path.write_bytes('# ok\nname = "Kö"\n'.encode(encoding))
        with pytest.raises(InputError) as caught:
            read_data(path)
        assert str(caught.value) == f"{path}: {problem.format(form)}; save it as UTF-8"
        with pytest.raises(InputError, match="save it as UTF-8"):
            read_secret(path)
    with pytest.raises(InputError, match=r"^order: .*; send UTF-8$"):
        parse_json('[\n"Kö"]'.encode(encoding), "order")


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
