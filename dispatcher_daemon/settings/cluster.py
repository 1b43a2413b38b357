"""Settings of the cluster: for the dispatcher, the scheduler and the workers."""

from __future__ import annotations

import ipaddress
import re
from pathlib import Path
from typing import Final, Self

from pydantic import Field, field_validator, model_validator

from slipstream.config import ServiceSettings, Settings, credential_path

LOCAL: Final = "local"
"""Address of a cluster inside the dispatcher's own process."""
_ADDRESS: Final = re.compile(r"(?P<scheme>tcp|tls)://(?P<host>\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):\d+")
_TLS_KEYS: Final = ("tls_ca", "tls_cert", "tls_key")


class ClusterSettings(Settings):
    """The cluster of several machines that solves (dask.distributed)."""

    address: str | None = Field(
        default=None,
        description='The scheduler, as "tcp://10.0.0.5:8786"; "local": a cluster inside the '
        "dispatcher, for a trial; None: the dispatcher's own processes.",
    )
    tls_ca: Path | None = Field(
        default=None,
        description="Certificate of the authority that signed those of scheduler, workers and "
        "dispatcher (PEM); it must sign nothing else. The three are needed for any address off "
        "loopback. Plain names are first looked for among systemd's credentials.",
    )
    tls_cert: Path | None = Field(default=None, description="This machine's certificate (PEM).")
    tls_key: Path | None = Field(default=None, description="The key of `tls_cert` (PEM).")

    @field_validator("address")
    @classmethod
    def _is_address(cls, address: str | None) -> str | None:
        if address in (None, LOCAL):
            return address
        match = _ADDRESS.fullmatch(address or "")
        if match is None:
            raise ValueError('not an address like "tcp://10.0.0.5:8786"')
        return address

    @model_validator(mode="after")
    def _strangers_cannot_connect(self) -> Self:
        given = [key for key in _TLS_KEYS if getattr(self, key) is not None]
        if given and len(given) < len(_TLS_KEYS):
            raise ValueError("tls_ca, tls_cert and tls_key go together; give all or none")
        if self.address in (None, LOCAL) or given:
            return self
        # What the members send each other is pickled: who can connect can run code.
        if not self.on_loopback:
            raise ValueError(
                "address is not on loopback: give tls_ca, tls_cert and tls_key, as whoever can "
                "connect can run code"
            )
        if (self.address or "").startswith("tls:"):
            raise ValueError("address asks for TLS: give tls_ca, tls_cert and tls_key")
        return self

    @property
    def host(self) -> str:
        """Of the address; "" without one."""
        match = _ADDRESS.fullmatch(self.address or "")
        return "" if match is None else match["host"].strip("[]")

    @property
    def on_loopback(self) -> bool:
        """Whether the address is certainly this machine's own."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def url(self) -> str:
        """The address with the scheme that is used: tls with certificates."""
        address = self.address or ""
        return address if self.tls_ca is None else address.replace("tcp://", "tls://", 1)

    @property
    def tls_files(self) -> dict[str, Path]:
        """By key, the files; none without TLS."""
        given = {key: getattr(self, key) for key in _TLS_KEYS}
        return {key: credential_path(path) for key, path in given.items() if path is not None}


class _MemberSettings(Settings):
    cluster: ClusterSettings = Field(description="The scheduler's address, and certificates.")
    service: ServiceSettings = Field(
        default=ServiceSettings(), description="Metrics and log of the service."
    )

    @model_validator(mode="after")
    def _has_address(self) -> Self:
        if self.cluster.address in (None, LOCAL):
            raise ValueError("cluster.address has to be the scheduler's address")
        return self


class SchedulerSettings(_MemberSettings):
    """All settings of the cluster's scheduler, which listens on `cluster.address`."""


class WorkerSettings(_MemberSettings):
    """All settings of one worker of the cluster."""

    processes: int = Field(
        default=2,
        ge=1,
        le=256,
        description="Number of processes that compute at once. The sum over all workers is what "
        "`city.search.workers` of the dispatcher should be.",
    )
    port: int = Field(
        default=0, ge=0, le=65535, description="Port to listen on; 0: any that is free."
    )
