from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dispatcher_daemon.settings import (
    ClusterSettings,
    DispatcherSettings,
    SchedulerSettings,
    WorkerSettings,
)
from slipstream.config import check
from slipstream.errors import InputError

FILES = {"tls_ca": "ca.pem", "tls_cert": "cert.pem", "tls_key": "key.pem"}


@pytest.mark.parametrize(
    ("cluster", "said"),
    [
        ({"address": "tcp://10.0.0.5:8786"}, "not on loopback"),
        ({"address": "tcp://0.0.0.0:8786"}, "not on loopback"),
        ({"address": "tcp://[::]:8786"}, "not on loopback"),
        ({"address": "tcp://server:8786"}, "not on loopback"),
        ({"address": "tcp://localhost.example.org:8786"}, "not on loopback"),
        ({"address": "tcp://127.0.0.1.example.org:8786"}, "not on loopback"),
        ({"address": "tls://127.0.0.1:8786"}, "asks for TLS"),
        ({"address": "tcp://10.0.0.5:8786", "tls_ca": "ca.pem"}, "go together"),
        ({"address": "10.0.0.5:8786", **FILES}, "not an address"),
        ({"address": "tcp://user@127.0.0.1:8786/x", **FILES}, "not an address"),
    ],
)
def test_strangers_cannot_be_let_in(cluster: dict[str, str], said: str) -> None:
    """Off loopback nothing goes without certificates; one line says what is missing."""
    for data in ({"cluster": cluster}, {"cluster": cluster, "seed": 1}):
        model = DispatcherSettings if "seed" in data else WorkerSettings
        with pytest.raises(InputError, match=said) as refused:
            check(data, model, "file.toml")
        assert refused.value.key in ("cluster", "cluster.address")


def test_certificates_open_other_machines() -> None:
    """With them an address anywhere is taken, and TLS is what is spoken."""
    settings = check({"address": "tcp://10.0.0.5:8786", **FILES}, ClusterSettings, "file.toml")
    assert settings.url == "tls://10.0.0.5:8786"
    assert settings.tls_files == {key: Path(name) for key, name in FILES.items()}
    for host in ("127.0.0.1", "127.1.2.3", "localhost", "[::1]"):
        own = check({"address": f"tcp://{host}:8786"}, ClusterSettings, "file.toml")
        assert own.url == f"tcp://{host}:8786"


@pytest.mark.parametrize("model", [SchedulerSettings, WorkerSettings])
@pytest.mark.parametrize("cluster", [{}, {"address": "local"}])
def test_members_need_an_address(
    model: type[SchedulerSettings | WorkerSettings], cluster: dict[str, str]
) -> None:
    """A scheduler or worker without one would reach nobody."""
    with pytest.raises(InputError, match="has to be the scheduler's address"):
        check({"cluster": cluster}, model, "file.toml")


@pytest.mark.process
@pytest.mark.long
def test_without_the_setting_nothing_of_it_is_loaded() -> None:
    """The dispatcher's modules do not import dask."""
    code = (
        "import dispatcher_daemon.service.daemon, sys\n"
        "print([m for m in sys.modules if m.split('.')[0] in ('dask', 'distributed')"
        " or 'execution.cluster' in m])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True
    )
    assert done.stdout == "[]\n"
