"""Results in a file, from which an interrupted run resumes."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from slipstream.errors import InputError
from slipstream.files import MAX_RESULTS_BYTES, read_file

Record = dict[str, Any]
"""One row's result on one instance, as plain data."""


class Store:
    """JSON lines, one record each; a last line that was cut short is dropped and measured again.

    Open until left as a context manager: one run at a time writes to a file.

    Args:
        path: of the file; its folder is made. None: kept in memory only.
        stamp: what else the results depend on; records with another stamp are left alone.
        read_only: nothing is made, locked or written; a missing file holds no records.

    Raises:
        InputError: the file cannot be read or written, is damaged, or another run writes to it.
    """

    def __init__(
        self, path: Path | None, stamp: Mapping[str, Any], *, read_only: bool = False
    ) -> None:
        self._path = path
        self._stamp = json.loads(json.dumps(stamp))
        self._records: dict[tuple[str, str], Record] = {}
        self._file: int | None = None
        if path is None:
            return
        try:
            data = _read(path) if read_only else self._open(path)
        except OSError as error:
            raise InputError(
                path, error.strerror or "not writable", "give another folder", key="--out"
            ) from None
        try:
            for record in _parse(path, data):
                if record["stamp"] == self._stamp:
                    self._records[record["row"], record["instance"]] = record
        except InputError:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close and unlock the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def get(self, row: str, instance: str) -> Record | None:
        """The result of a row on an instance, if there is one."""
        return self._records.get((row, instance))

    def put(self, row: str, instance: str, result: Record) -> Record:
        """Keep a result; it is on disk when this returns.

        Raises:
            OSError: the disk is full; names the file.
        """
        record = {"row": row, "instance": instance, "stamp": self._stamp, **result}
        if self._file is not None:
            line = (json.dumps(record) + "\n").encode()
            try:
                while line:
                    line = line[os.write(self._file, line) :]
                os.fsync(self._file)
            except OSError as error:
                raise OSError(error.errno, error.strerror, str(self._path)) from None
        self._records[row, instance] = record
        return record

    def _open(self, path: Path) -> bytes:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            data = _read(path)
            # What was cut short must not stay in front of the next record.
            os.ftruncate(file, data.rfind(b"\n") + 1)
        except InputError:
            os.close(file)
            raise
        except OSError as error:
            os.close(file)
            if error.errno in (errno.EAGAIN, errno.EACCES):
                raise InputError(
                    path.parent,
                    "another run is at it",
                    "wait for its end, show what it has with --stored, or give another folder",
                    key="--out",
                ) from None
            raise
        self._file = file
        return data


def _read(path: Path) -> bytes:
    return read_file(path, MAX_RESULTS_BYTES) if path.exists() else b""


def _parse(path: Path, data: bytes) -> Iterator[Record]:
    """The records of all whole lines.

    Raises:
        InputError: one of them is none; names the line.
    """
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        if not line:
            continue
        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            record = None
        if not (
            isinstance(record, dict)
            and isinstance(record.get("row"), str)
            and isinstance(record.get("instance"), str)
            and isinstance(record.get("stamp"), dict)
        ):
            raise InputError(
                path,
                "this is no record of a result",
                "delete the line, its result is measured again, or give another folder",
                key=f"line {number}",
            )
        yield record
