"""Connections that are given up while they are made."""

from __future__ import annotations

import gc
import socket

import distributed
import pytest

from dispatcher_daemon.settings import ClusterSettings
from dispatcher_daemon.solvers.cluster.client import Cluster


@pytest.mark.slow
def test_a_client_that_is_given_up_while_it_connects_is_closed() -> None:
    """One that is not closes itself when it is collected, on a loop that has ended: an error."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        silent.settimeout(20.0)
        cluster = Cluster(ClusterSettings(address=f"tcp://127.0.0.1:{silent.getsockname()[1]}"), 1)
        asking, _ = silent.accept()
        cluster.close()
        asking.close()
    clients = [found for found in gc.get_objects() if type(found) is distributed.Client]
    assert {client.status for client in clients} <= {"closed"}
    assert not cluster.wait_for(1, 0.0)
