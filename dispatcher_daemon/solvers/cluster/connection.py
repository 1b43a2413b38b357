"""A connection to a cluster: to a scheduler elsewhere, or to one in this process."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

from dispatcher_daemon.settings import ClusterSettings
from dispatcher_daemon.solvers.cluster.calls import use_processes
from dispatcher_daemon.solvers.cluster.security import (
    ANY_LOOPBACK_PORT,
    import_distributed,
)
from dispatcher_daemon.solvers.workers.pool import error_line
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor

log = logging.getLogger(__name__)

_CONNECT_S: Final = 5.0
_CLOSE_S: Final = 2.0


@asynccontextmanager
async def connected(
    settings: ClusterSettings, security: Any, own: WorkerExecutor | None, processes: int
) -> AsyncIterator[Any]:
    """An asynchronous `distributed.Client`; closed with the block, as far as that goes in time.

    Args:
        own: processes of a worker in this process, with a scheduler beside it; None: the
            scheduler is at the settings' address.
        processes: their number.

    Raises:
        OSError: nobody answers at the address.
    """
    opened: list[Any] = []
    try:
        address: str = settings.url
        if own is not None:
            opened.append(_local_cluster(own, processes))
            await opened[0]
            address = opened[0].scheduler_address
        client = import_distributed().Client(
            address,
            asynchronous=True,
            set_as_default=False,
            security=security,
            timeout=_CONNECT_S,
            name="slipstream-dispatcher",
        )
        # Before it is awaited: one that is cancelled while it connects does not close itself.
        opened.append(client)
        await client
        yield client
    finally:
        for closing in reversed(opened):
            await closed(closing.close(), _CLOSE_S)


def _local_cluster(own: WorkerExecutor, processes: int) -> Any:
    """One that starts when it is awaited."""
    use_processes(own)
    return import_distributed().LocalCluster(
        n_workers=1,
        threads_per_worker=processes,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": ANY_LOOPBACK_PORT},
        worker_dashboard_address=ANY_LOOPBACK_PORT,
        memory_limit=0,
        asynchronous=True,
    )


async def closed(closing: Any, within_s: float) -> None:
    """Wait for something to close, but not for long; errors do not matter any more."""
    try:
        await asyncio.wait_for(closing, within_s)
    except Exception as error:
        log.debug("closing: %s", error_line(error))
