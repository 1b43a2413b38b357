"""Files from outside, and what is wrong with them in one line; cells of files for spreadsheets."""

from __future__ import annotations

import codecs
import gzip
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from slipstream.errors import InputError

MAX_RESULTS_BYTES: Final = 256_000_000
"""Size of a file of results that the laboratory has stored and reads again."""
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
_GZIP = b"\x1f\x8b"
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def check_file(path: Path, max_bytes: int, mend: str = "check the path") -> None:
    """Check that a path names a file of bounded size.

    Raises:
        InputError: there is no such file, or it is too large; with ``mend`` for the former.
    """
    try:
        found = path.stat()
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        problem = "no such file" if missing else error.strerror or "not readable"
        raise InputError(path, problem, mend) from None
    if not stat.S_ISREG(found.st_mode):
        problem = "is a directory" if stat.S_ISDIR(found.st_mode) else "no regular file"
        raise InputError(path, problem, mend)
    if found.st_size > max_bytes:
        problem = f"larger than {max_bytes / 1e6:g} MB"
        raise InputError(path, problem, "give a smaller file")


def read_file(path: Path, max_bytes: int, mend: str = "check the path") -> bytes:
    """Read a file of bounded size; as for `check_file`.

    Raises:
        InputError: as `check_file`; also, it cannot be read.
    """
    check_file(path, max_bytes, mend)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", mend) from None


def read_text(path: Path, max_bytes: int, form: str = "text") -> str:
    """Read a text file of bounded size.

    Raises:
        InputError: as `read_file` and `text_of`.
    """
    return text_of(read_file(path, max_bytes), path, form)


def text_of(data: bytes, source: str | Path, form: str = "text") -> str:
    """Text as editors of all systems write it: UTF-8, a byte order mark is left out, and lines,
    whether they end in LF, CRLF or CR, end in LF.

    Args:
        data: the bytes.
        source: the file, or the name of what did not come as a file; for errors.
        form: what it has to be; for errors.

    Raises:
        InputError: it is in another encoding.
    """
    mend = "save it as UTF-8" if isinstance(source, Path) else "send UTF-8"
    # Without its mark UTF-16 is valid UTF-8, with a NUL beside each letter.
    if data.startswith(_UTF_16) or b"\0" in data[:4]:
        raise InputError(source, f"not {form}: encoded in UTF-16 or UTF-32", mend)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(source, f"not {form}: not UTF-8", mend, key=f"line {line}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def harmless_cell(text: str) -> str:
    """A text of a CSV file that no spreadsheet takes for a formula: an apostrophe stands before
    what it would. One with apostrophes before that gets one more, so that without its first
    each is what it was.
    """
    return f"'{text}" if text.lstrip("'").startswith(_FORMULA) else text


def ending_of(path: Path) -> str:
    """What a file's name ends in, such as ``.json``: it says the format, in capitals too."""
    return path.suffix.lower()


@contextmanager
def open_unpacked(path: Path, mend: str = "check the path") -> Iterator[IO[bytes] | gzip.GzipFile]:
    """A file to read from its beginning, unpacked where it is packed with gzip.

    Raises:
        InputError: there is no such file, with ``mend``.
        OSError, EOFError, zlib.error: it cannot be read, or the packed data is damaged.
    """
    check_file(path, sys.maxsize, mend)
    with path.open("rb") as file:
        packed = file.read(len(_GZIP)) == _GZIP
        file.seek(0)
        if packed:
            with gzip.GzipFile(fileobj=file) as unpacked:
                yield unpacked
        else:
            yield file


@contextmanager
def silent_libraries() -> Iterator[None]:
    """Nothing is written to standard error: libraries in C tell there, line by line, what they find
    wrong with a file. The caller tells it in one line.
    """
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
