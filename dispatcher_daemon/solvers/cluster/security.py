"""TLS of the cluster: both ends show a certificate of the cluster's own authority."""

from __future__ import annotations

import logging
import ssl
from importlib import import_module
from typing import Any, Final

from dispatcher_daemon.settings import ClusterSettings
from slipstream.errors import InputError

ANY_LOOPBACK_PORT: Final = "127.0.0.1:0"
"""Of the members' pages, which cannot be turned off."""


def security_of(settings: ClusterSettings) -> Any:
    """The `distributed.Security` of the settings, for every member and the dispatcher.

    Raises:
        InputError: a file is missing or is not what its key says; the extra is not installed.
    """
    distributed = import_distributed()
    files = settings.tls_files
    if not files:
        return distributed.Security(require_encryption=False)
    for key, path in files.items():
        try:
            path.read_bytes()
        except OSError as error:
            problem = f"cannot be read: {error.strerror}"
            raise InputError(path, problem, "mend the path", key=f"cluster.{key}") from None
    ca, cert, key_file = (str(files[key]) for key in ("tls_ca", "tls_cert", "tls_key"))
    try:
        context = ssl.create_default_context(cafile=ca)
        context.load_cert_chain(cert, key_file)
    except ssl.SSLError as error:
        raise InputError(
            cert, f"not a certificate with its key: {error.reason}", "mend the files", key="cluster"
        ) from None
    pairs = {
        f"tls_{role}_{kind}": path
        for role in ("client", "scheduler", "worker")
        for kind, path in (("cert", cert), ("key", key_file))
    }
    return distributed.Security(require_encryption=True, tls_ca_file=ca, **pairs)


def import_distributed() -> Any:
    """The package `distributed`, with its own log silenced: what matters is said in one line by us.

    Raises:
        InputError: the extra is not installed.
    """
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError:
        raise InputError(
            "cluster.address", "the extra is not installed", "pip install 'slipstream[cluster]'"
        ) from None
    # Its loggers have levels of their own.
    top = logging.getLogger("distributed")
    top.handlers, top.propagate = [logging.NullHandler()], False
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed."):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    return distributed
