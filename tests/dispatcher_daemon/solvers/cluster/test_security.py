from __future__ import annotations

import math
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import psutil
import pytest

from dispatcher_daemon.settings import ClusterSettings
from dispatcher_daemon.solvers.cluster.client import Cluster
from dispatcher_daemon.solvers.cluster.security import security_of
from slipstream.errors import InputError

from .conftest import Members, wait_until


@pytest.fixture
def certificates(tool: Callable[[str], str], tmp_path: Path) -> dict[str, Path]:
    """Files by settings key; `other_cert` and `other_key` are signed by another authority."""
    openssl = tool("openssl")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout")

    def run(*arguments: str) -> None:
        subprocess.run([openssl, *arguments], cwd=tmp_path, check=True, capture_output=True)

    for ca, name in (("ca", "cluster"), ("stranger", "other")):
        run("req", "-x509", *key, f"{ca}.key", "-out", f"{ca}.pem", "-subj", f"/CN={ca}")
        run("req", *key, f"{name}.key", "-out", "request", "-subj", f"/CN={name}")
        run(
            *("x509", "-req", "-in", "request", "-CA", f"{ca}.pem", "-CAkey", f"{ca}.key"),
            *("-CAcreateserial", "-days", "2", "-out", f"{name}.pem"),
        )
    return {
        "tls_ca": tmp_path / "ca.pem",
        "tls_cert": tmp_path / "cluster.pem",
        "tls_key": tmp_path / "cluster.key",
        "other_cert": tmp_path / "other.pem",
        "other_key": tmp_path / "other.key",
    }


@pytest.fixture
def closed_members(certificates: dict[str, Path], tmp_path: Path) -> Iterator[Members]:
    """A scheduler and a worker that speak TLS."""
    keys = {key: path for key, path in certificates.items() if key.startswith("tls")}
    members = Members(tmp_path, **keys)
    try:
        members.start_scheduler()
        members.start_worker()
        yield members
    finally:
        members.end()


@pytest.mark.process
@pytest.mark.attack
@pytest.mark.long
def test_only_who_has_a_certificate_of_the_authority_is_let_in(
    closed_members: Members,
    certificates: dict[str, Path],
    connected: Callable[[ClusterSettings, int], AbstractContextManager[Cluster]],
    caplog: pytest.LogCaptureFixture,
) -> None:
    """With it calls are answered; without one, or with one of another authority, nothing connects.
    No port is open but on loopback.
    """
    with connected(closed_members.settings, 1) as cluster:
        assert cluster.submit(math.hypot, (3.0, 4.0), 60.0, 60.0).result(90) == 5.0
    address = closed_members.settings.address
    stranger = closed_members.settings.model_copy(
        update={"tls_cert": certificates["other_cert"], "tls_key": certificates["other_key"]}
    )
    for settings in (ClusterSettings(address=address), stranger):
        caplog.clear()
        refused = Cluster(settings, 1)
        try:
            wait_until(lambda: any("this machine solves" in line for line in caplog.messages))
            assert refused.slots == 0
        finally:
            refused.close()
    processes = (closed_members.scheduler, *closed_members.workers)
    addresses = {
        c.laddr.ip
        for process in processes
        if process is not None
        for c in psutil.Process(process.pid).net_connections()
        if c.status == psutil.CONN_LISTEN
    }
    assert addresses == {"127.0.0.1"}
    with connected(closed_members.settings, 1):
        pass


def test_files_that_are_no_certificates_are_named(
    certificates: dict[str, Path], tmp_path: Path
) -> None:
    """A missing file, and a key of another certificate, are one line each."""

    def refused(**changed: Path) -> InputError:
        files = {key: path for key, path in certificates.items() if key.startswith("tls")}
        settings = ClusterSettings(address="tcp://10.0.0.5:8786", **{**files, **changed})
        with pytest.raises(InputError) as error:
            security_of(settings)
        return error.value

    missing = refused(tls_key=tmp_path / "none.key")
    assert (missing.key, missing.mend) == ("cluster.tls_key", "mend the path")
    assert "not a certificate with its key" in refused(tls_key=certificates["other_key"]).problem
    empty = tmp_path / "empty.pem"
    empty.touch()
    assert "not a certificate with its key" in refused(tls_ca=empty).problem
