"""Credentials for IBM's services: from the environment or systemd, never from a settings file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from slipstream.errors import InputError

TOKEN: Final = "QISKIT_IBM_TOKEN"
INSTANCE: Final = "QISKIT_IBM_INSTANCE"
TOKEN_CREDENTIAL: Final = "ibm-quantum-token"
INSTANCE_CREDENTIAL: Final = "ibm-quantum-instance"


@dataclass(frozen=True)
class Account:
    """An account at IBM Quantum.

    Attributes:
        token: secret; no repr, log line or message of ours has it.
        instance: CRN or name of the instance that is charged; None: the account's default.
    """

    token: str = field(repr=False)
    instance: str | None = None

    def clean(self, line: str) -> str:
        """A line without the token, should a service have put it there."""
        return line.replace(self.token, "***")


def read_account(environment: Mapping[str, str] | None = None) -> Account:
    """The account of this process.

    A systemd credential (`LoadCredential=ibm-quantum-token:...`) goes before the variables
    QISKIT_IBM_TOKEN and QISKIT_IBM_INSTANCE.

    Args:
        environment: None: this process's.

    Raises:
        InputError: there is no token, or its credential is not readable or empty.
    """
    environment = os.environ if environment is None else environment
    token = _credential(TOKEN_CREDENTIAL, environment) or environment.get(TOKEN, "").strip()
    if not token:
        raise InputError(
            "IBM Quantum",
            "no credentials",
            f"set {TOKEN} in the environment or give systemd's credential {TOKEN_CREDENTIAL}",
        )
    instance = _credential(INSTANCE_CREDENTIAL, environment) or environment.get(INSTANCE, "")
    return Account(token, instance.strip() or None)


def _credential(name: str, environment: Mapping[str, str]) -> str | None:
    folder = environment.get("CREDENTIALS_DIRECTORY")
    path = Path(folder, name) if folder else None
    if path is None or not path.exists():
        return None
    try:
        text = path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError):
        raise InputError(path, "not readable", "check the credential of the unit") from None
    if not text:
        raise InputError(path, "empty", "check the credential of the unit")
    return text
