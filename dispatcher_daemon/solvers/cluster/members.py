"""The processes of a cluster: its scheduler, and its workers."""

from __future__ import annotations

import asyncio
import logging
import tempfile
from functools import partial
from typing import Any, Final

from dispatcher_daemon.settings import SchedulerSettings, WorkerSettings
from dispatcher_daemon.solvers.cluster.calls import build, use_processes
from dispatcher_daemon.solvers.cluster.connection import closed
from dispatcher_daemon.solvers.cluster.security import (
    ANY_LOOPBACK_PORT,
    import_distributed,
    security_of,
)
from dispatcher_daemon.solvers.workers.pool import error_line
from dispatcher_daemon.solvers.workers.processes import WorkerExecutor
from slipstream.errors import InputError
from slipstream.service import Service, configure_logging

log = logging.getLogger(__name__)

_BEAT_S: Final = 0.5
_CONNECT_S: Final = 10.0
_RETRY_S: Final = 2.0
_CLOSE_S: Final = 3.0


def run_scheduler(settings: SchedulerSettings) -> None:
    """Distribute calls over the workers until SIGTERM or SIGINT.

    Raises:
        InputError: a file cannot be used, or the address is not free.
    """
    configure_logging("scheduler", settings.service)
    distributed, security = import_distributed(), security_of(settings.cluster)
    with Service("scheduler", settings.service) as service:
        asyncio.run(_schedule(settings, distributed, security, service))


async def _schedule(
    settings: SchedulerSettings, distributed: Any, security: Any, service: Service
) -> None:
    scheduler = distributed.Scheduler(
        host=settings.cluster.url,
        port=0,
        security=security,
        dashboard=False,
        dashboard_address=ANY_LOOPBACK_PORT,
    )
    try:
        await scheduler
    except (OSError, RuntimeError) as error:
        cause = error.__cause__ or error
        raise InputError(
            str(settings.cluster.address),
            f"cannot listen: {error_line(cause)}",
            "choose a free port of this machine",
            key="cluster.address",
        ) from None
    service.ready()
    while not service.stopping.is_set():
        await asyncio.sleep(_BEAT_S)
        service.progress(f"{len(scheduler.workers)} workers")
    await scheduler.close()


def run_worker(settings: WorkerSettings) -> None:
    """Run calls of the cluster in processes of this machine until SIGTERM or SIGINT.

    Raises:
        InputError: a file cannot be used.
    """
    configure_logging("worker", settings.service)
    distributed, security = import_distributed(), security_of(settings.cluster)
    executor = WorkerExecutor(settings.processes)
    use_processes(executor)
    log.info("%s", build())
    with Service("worker", settings.service) as service:
        temporary = partial(tempfile.TemporaryDirectory, prefix="slipstream-worker-")
        folder = service.start("folder", temporary)
        service.on_stop("processes", executor.shutdown)
        asyncio.run(_work(settings, distributed, security, service, folder))


async def _work(
    settings: WorkerSettings, distributed: Any, security: Any, service: Service, folder: str
) -> None:
    """Join the cluster, again and again where the scheduler is away."""
    known = ""
    service.ready()
    while not service.stopping.is_set():
        reason = await _member(settings, distributed, security, service, folder)
        if service.stopping.is_set():
            return
        if reason != known:
            known = reason
            log.warning("%s: %s; trying again", settings.cluster.address, reason)
        await asyncio.sleep(_RETRY_S)


async def _member(
    settings: WorkerSettings, distributed: Any, security: Any, service: Service, folder: str
) -> str:
    """One membership; why it is over."""
    try:
        own = distributed.utils.get_ip(settings.cluster.host)
        worker = distributed.Worker(
            settings.cluster.url,
            nthreads=settings.processes,
            host=f"[{own}]" if ":" in own else own,
            port=settings.port,
            security=security,
            dashboard=False,
            dashboard_address=ANY_LOOPBACK_PORT,
            local_directory=folder,
            memory_limit=0,
            death_timeout=_CONNECT_S,
        )
    except (OSError, ValueError) as error:
        return error_line(error)
    joining = asyncio.ensure_future(worker.start())
    try:
        while not joining.done() and not service.stopping.is_set():
            await asyncio.wait((joining,), timeout=_BEAT_S)
            service.progress("joining")
        if not joining.done():
            return "stopping"
        failed = joining.exception()
        if failed is not None:
            return error_line(failed)
        log.info("joined %s", settings.cluster.address)
        while not service.stopping.is_set() and worker.status.name == "running":
            await asyncio.sleep(_BEAT_S)
            service.progress("working")
        return "the scheduler is gone"
    finally:
        joining.cancel()
        await closed(worker.close(timeout=1), _CLOSE_S)
