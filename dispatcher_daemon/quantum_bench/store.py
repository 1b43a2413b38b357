"""Results as they come, in a file that an interrupted run goes on from."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from slipstream.errors import InputError

Record = dict[str, Any]
"""One row's result on one instance, as plain data."""


class Store:
    """JSON lines, one record each; a record that was cut short is measured again.

    Args:
        path: of the file; its folder is made. None: kept in memory only.
        stamp: what else the results depend on; records with another stamp are left alone.

    Raises:
        InputError: the file cannot be read or written.
    """

    def __init__(self, path: Path | None, stamp: Mapping[str, Any]) -> None:
        self._path = path
        self._stamp = json.loads(json.dumps(stamp))
        self._records: dict[tuple[str, str], Record] = {}
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a+b") as file:
                file.seek(0)
                lines = file.read().split(b"\n")
                if lines[-1]:
                    file.write(b"\n")
        except OSError as error:
            raise InputError(
                path, error.strerror or "not writable", "give another folder", key="--out"
            ) from None
        for line in lines:
            try:
                record = json.loads(line)
            except ValueError:
                continue
            if isinstance(record, dict) and record.get("stamp") == self._stamp:
                self._records[record["row"], record["instance"]] = record

    def get(self, row: str, instance: str) -> Record | None:
        """The result of a row on an instance, if there is one."""
        return self._records.get((row, instance))

    def put(self, row: str, instance: str, result: Record) -> Record:
        """Keep a result; it is on disk when this returns."""
        record = {"row": row, "instance": instance, "stamp": self._stamp, **result}
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
                file.flush()
                os.fsync(file.fileno())
        self._records[row, instance] = record
        return record
