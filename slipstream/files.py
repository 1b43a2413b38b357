"""Files from outside: only regular ones are read, and only of bounded size.

A pipe or a device given as a file would be read for ever, a huge one until memory is full.
"""

from __future__ import annotations

import codecs
import gzip
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

from slipstream.errors import InputError

MAX_RESULTS_BYTES: Final = 256_000_000
"""Size of a file of results that the laboratory has stored and reads again."""
_GZIP = b"\x1f\x8b"
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def check_file(path: Path, max_bytes: int, mend: str = "check the path") -> None:
    """Check that a path names a regular file of bounded size.

    Args:
        path: the file.
        max_bytes: its largest size.
        mend: what to do where there is no such file.

    Raises:
        InputError: there is no such file; it is a directory, pipe, device or socket; or too large.
    """
    try:
        found = path.stat()
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        problem = "no such file" if missing else error.strerror or "not readable"
        raise InputError(path, problem, mend) from None
    except ValueError:  # a NUL in it
        raise InputError(path, "not a path", mend) from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError(path, "is a directory", mend)
    if not stat.S_ISREG(found.st_mode):
        raise InputError(path, "a pipe, device or socket, no regular file", mend)
    if found.st_size > max_bytes:
        raise too_large(path, max_bytes)


def read_file(path: Path, max_bytes: int, mend: str = "check the path") -> bytes:
    """Read a regular file of bounded size; arguments as for `check_file`.

    Raises:
        InputError: as `check_file`; also, it cannot be read.
    """
    check_file(path, max_bytes, mend)
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", mend) from None
    if len(data) > max_bytes:
        raise too_large(path, max_bytes)
    return data


def read_text(path: Path, max_bytes: int, form: str = "text") -> str:
    """Read a regular text file of bounded size; arguments as for `check_file` and `text_of`.

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


def ending_of(path: Path) -> str:
    """What a file's name ends in, such as ``.json``: it says the format, in capitals too."""
    return path.suffix.lower()


@contextmanager
def open_unpacked(
    path: Path, max_bytes: int, mend: str = "check the path"
) -> Iterator[BoundedReader]:
    """A regular file to read from its beginning, unpacked where it is packed with gzip.

    Args:
        path: the file.
        max_bytes: largest size of the file, and of what it unpacks to.
        mend: what to do where there is no such file.

    Raises:
        InputError: as `check_file`; also while reading, where it unpacks to more.
        OSError, EOFError, zlib.error: while reading, where the packed data is damaged.
    """
    check_file(path, max_bytes, mend)
    try:
        file = path.open("rb")
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", mend) from None
    with file:
        packed = file.read(len(_GZIP)) == _GZIP
        file.seek(0)
        if packed:
            with gzip.GzipFile(fileobj=file) as unpacked:
                yield BoundedReader(unpacked, path, max_bytes)
        else:
            yield BoundedReader(file, path, max_bytes)


class BoundedReader:
    """A file that ends with an InputError where more is read from it than may be."""

    def __init__(self, file: BinaryIO | gzip.GzipFile, path: Path, max_bytes: int) -> None:
        self._file = file
        self._path = path
        self._max_bytes = max_bytes
        self._left = max_bytes

    def read(self, size: int = -1, /) -> bytes:
        """Up to so many bytes, or all; none at the end."""
        data = self._file.read(self._left + 1 if size < 0 else size)
        self._left -= len(data)
        if self._left < 0:
            raise too_large(self._path, self._max_bytes)
        return data

    def close(self) -> None:
        """Close the file; some parsers do when they have read it."""
        self._file.close()


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


def too_large(path: Path, max_bytes: int) -> InputError:
    """The error for a file that is larger than what is read of its kind."""
    return InputError(path, f"larger than {max_bytes / 1e6:g} MB", "give a smaller file")
