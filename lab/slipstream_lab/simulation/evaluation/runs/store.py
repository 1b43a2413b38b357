"""Finished arms in a folder, each with its provenance; a later run continues from them."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, Self

from pydantic import TypeAdapter, ValidationError

from slipstream.errors import InputError
from slipstream.files import MAX_RESULTS_BYTES, read_file
from slipstream_lab.simulation.closed_loop.policy import Policy
from slipstream_lab.simulation.closed_loop.record import ArmResult
from slipstream_lab.simulation.evaluation.runs.provenance import Provenance

_NEW_FOLDER: Final = "give another folder, or empty this one to simulate all anew"


@dataclass(frozen=True)
class StoredArm:
    """One stored arm of one seed."""

    file: str
    digest: str
    code: str
    result: ArmResult


class ArmStore:
    """The arms of one folder; another run must not write to it until this is left.

    Args:
        folder: of the evaluation; made with its parents.

    Raises:
        InputError: the folder cannot be written, or another run is at it.
    """

    def __init__(self, folder: Path, provenance: Provenance, code: str) -> None:
        self.folder = folder
        self._provenance: dict[str, Any] = json.loads(json.dumps(asdict(provenance)))
        self._code = code
        try:
            (folder / "arms").mkdir(parents=True, exist_ok=True)
            self._lock = os.open(
                folder / "arms" / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666
            )
        except OSError as error:
            raise not_writable(folder, error) from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._lock)
            raise InputError(
                folder, "another run is at it", "wait for its end", key="--out"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._lock)

    def put(self, policy: Policy, seed: int, result: ArmResult) -> None:
        """Keep an arm; its file is there as a whole or not at all. Raises OSError: the disk is
        full.
        """
        document = {
            "ground": self._provenance,
            "policy": _plain(policy),
            "seed": seed,
            "code": self._code,
            "result": _RESULT.dump_python(result, mode="json"),
        }
        path = self._path(policy.name, seed)
        write_atomically(path, json.dumps(document, allow_nan=False) + "\n")

    def get(self, policy: Policy, seed: int) -> StoredArm | None:
        """An arm, if it is there. Raises InputError: its file is damaged, or of another
        evaluation.
        """
        path = self._path(policy.name, seed)
        if not path.exists():
            return None
        data = read_file(path, MAX_RESULTS_BYTES)
        try:
            document = json.loads(data)
            provenance, code = document["ground"], str(document["code"])
            self._compare(provenance)
            if document["policy"] != _plain(policy) or document["seed"] != seed:
                raise InputError(
                    self.folder,
                    f"{path.name} is the arm of another policy or seed",
                    _NEW_FOLDER,
                    key="--out",
                )
            # Not from the parsed document: there numbers would be checked as Python's.
            result = _RESULT.validate_json(json.dumps(document["result"]))
        except (ValueError, KeyError, TypeError, RecursionError, ValidationError):
            raise InputError(
                path, "this is no arm's result", "delete the file, it is simulated again"
            ) from None
        return StoredArm(f"arms/{path.name}", sha256(data).hexdigest()[:12], code, result)

    def _compare(self, provenance: Mapping[str, Any]) -> None:
        """Refuse arms that were simulated on another ground."""
        words = [
            f"{name} was {_short(provenance.get(name))}, is {_short(value)}"
            for name, value in self._provenance.items()
            if provenance.get(name) != value
        ]
        if words:
            raise InputError(
                self.folder,
                f"it holds arms of another evaluation ({'; '.join(words)})",
                _NEW_FOLDER,
                key="--out",
            )

    def _path(self, name: str, seed: int) -> Path:
        return self.folder / "arms" / f"{name}-{seed}.json"


def not_writable(path: Path, error: OSError) -> InputError:
    """What a folder or file that cannot be written becomes."""
    return InputError(path, error.strerror or "not writable", "give another folder", key="--out")


def write_atomically(path: Path, text: str) -> None:
    """Write a file that other processes see as a whole or not at all."""
    part = path.with_name(f".{path.name}.part")
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def _plain(policy: Policy) -> dict[str, Any]:
    return {**asdict(policy), "levers": sorted(policy.levers)}


def _short(value: object) -> str:
    """A value in words; digests by their first digits."""
    text = str(value)
    return text[:8] if len(text) == 64 else text or "none"


_RESULT: Final = TypeAdapter(ArmResult)
