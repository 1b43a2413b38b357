"""Access to IBM Quantum: credentials, and a client whose calls have timeouts."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from slipstream.errors import InputError
from slipstream.files import read_text

TOKEN = "QISKIT_IBM_TOKEN"
INSTANCE = "QISKIT_IBM_INSTANCE"
ADDRESS = "SLIPSTREAM_IBM_URL"
TOKEN_CREDENTIAL = "ibm-quantum-token"
INSTANCE_CREDENTIAL = "ibm-quantum-instance"
CONNECT_S = 5.0
READ_S = 15.0
_MAX_CREDENTIAL_BYTES: Final = 65_536


@dataclass(frozen=True)
class AccountAccess:
    """Credentials and address of an account.

    Attributes:
        token: API key; not part of the representation.
        instance: CRN or name of the service instance; "auto": the client chooses.
        address: base URL of the REST interface, instead of IBM's own.
    """

    token: str = field(repr=False)
    instance: str = "auto"
    address: str | None = None


def find_access(environment: Mapping[str, str] | None = None) -> AccountAccess:
    """The token and instance from the environment, otherwise from systemd credentials.

    Variables `QISKIT_IBM_TOKEN` and `QISKIT_IBM_INSTANCE`; files `ibm-quantum-token` and
    `ibm-quantum-instance` in ``$CREDENTIALS_DIRECTORY``. `SLIPSTREAM_IBM_URL` replaces the address.

    Raises:
        InputError: there is no token.
    """
    known = os.environ if environment is None else environment
    folder = known.get("CREDENTIALS_DIRECTORY")
    token = known.get(TOKEN, "").strip() or _credential(folder, TOKEN_CREDENTIAL)
    if not token:
        raise InputError(
            "IBM Quantum",
            "there is no API key",
            f"set {TOKEN}, or provide the systemd credential {TOKEN_CREDENTIAL}",
        )
    instance = known.get(INSTANCE, "").strip() or _credential(folder, INSTANCE_CREDENTIAL)
    return AccountAccess(token, instance or "auto", known.get(ADDRESS) or None)


def open_client(access: AccountAccess) -> Any:
    """A `QiskitRuntimeService`; network calls are made.

    It has been given its token, so that the client's own file of accounts is not read.
    """
    _bound_calls()
    # It warns of requested settings; failures are raised.
    logging.getLogger("qiskit_ibm_runtime").setLevel(logging.ERROR)
    from qiskit_ibm_runtime import QiskitRuntimeService

    address = access.address
    return QiskitRuntimeService(
        channel="ibm_quantum_platform",
        token=access.token,
        instance=access.instance,
        url_resolver=None if address is None else lambda *_: address,
    )


def _credential(folder: str | None, name: str) -> str:
    if not folder:
        return ""
    path = Path(folder) / name
    if not path.exists():
        return ""
    try:
        return read_text(path, _MAX_CREDENTIAL_BYTES).strip()
    except InputError as error:
        problem = f"cannot be read ({error.problem})"
        raise InputError(path, problem, "check the credential") from None


def _bound_calls() -> None:
    """Give IBM's client a session with timeouts and without retries.

    Its own session has no read timeout (15 minutes when it submits) and tries five times.
    """
    from qiskit_ibm_runtime.api import client
    from qiskit_ibm_runtime.api.session import RetrySession
    from requests.adapters import HTTPAdapter

    if client.RetrySession is not RetrySession:
        return

    class BoundedSession(RetrySession):  # type: ignore[misc]
        def __init__(self, *args: Any, **kwargs: Any) -> None:
            super().__init__(*args, **kwargs)
            for scheme in ("http://", "https://"):
                self.mount(scheme, HTTPAdapter(max_retries=0))
            self.auth.tm.http_config = {"timeout": (CONNECT_S, READ_S)}

        def request(self, method: str, url: str, bare: bool = False, **kwargs: Any) -> Any:
            kwargs["timeout"] = (CONNECT_S, READ_S)
            return super().request(method, url, bare, **kwargs)

    client.RetrySession = BoundedSession
