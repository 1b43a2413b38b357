from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.api import (
    ApiServer,
    RateLimit,
    Services,
    create_app,
    token_hash,
)
from dispatcher_daemon.service.api.solving import SolveJobs
from dispatcher_daemon.service.dispatcher import AlarmSource, Dispatcher
from dispatcher_daemon.service.intake import OrderIntake
from dispatcher_daemon.settings import DispatcherSettings, OrderSettings
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import solve_in_process
from slipstream.http.conventions import Conventions
from slipstream.messages import SegmentState, state_key
from storage import open_database, open_reader
from tests.dispatcher_daemon.service.reporting import Bus

from .asgi import Answer, Listener, Request

SECRETS = {
    "reader": ("read",),
    "orderer": ("orders",),
    "controller": ("control",),
    "telematics": ("vehicles",),
}
"""A token of each scope; its text is its name."""


@dataclass
class Api:
    """The API of a dispatcher whose cycles the test runs.

    Attributes:
        port: that it is served on; 0: it is called without sockets.
    """

    port: int
    dispatcher: Dispatcher
    services: Services
    watched: AlarmSource
    app: Any
    loop: asyncio.AbstractEventLoop

    def ask(
        self,
        method: str,
        path: str,
        token: str | None = None,
        body: object = None,
        headers: dict[str, str] | None = None,
    ) -> Answer:
        """Send one request; what is neither None nor bytes is sent as JSON."""
        sent = dict(headers or {})
        if token is not None:
            sent["Authorization"] = f"Bearer {token}"
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
            sent.setdefault("Content-Type", "application/json")
        if not self.port:
            return Request(self.app, method, path, sent, body or b"").answer(self.loop)
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            names = {name.lower(): value for name, value in answer.getheaders()}
            return Answer(answer.status, names, answer.read())
        finally:
            connection.close()

    @contextmanager
    def listening(
        self, query: str = "", last_id: str | None = None, token: str | None = None
    ) -> Iterator[Listener]:
        """A caller of /v1/events, from whose answer's beginning on nothing is missed."""
        headers = {} if last_id is None else {"Last-Event-ID": last_id}
        headers |= {} if token is None else {"Authorization": f"Bearer {token}"}
        request = Request(self.app, "GET", f"/v1/events{query}", headers)
        with request.followed(self.loop) as parts:
            yield Listener(parts)

    def feed(self, state: SegmentState) -> None:
        """Send a segment's state as the bus does."""
        self.dispatcher.receiver.on_state(state_key(state.rsu, state.segment), state.to_bytes())

    def get(self, path: str, token: str | None = None) -> Answer:
        """Send a GET."""
        return self.ask("GET", path, token)


@pytest.fixture(scope="session")
def empty_database(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A database with its schema and nothing in it."""
    path = tmp_path_factory.mktemp("database") / "d.db"
    open_database(f"sqlite:///{path}").close()
    return path.read_bytes()


@pytest.fixture(scope="session")
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    """An event loop that runs on a thread of its own."""
    made = asyncio.new_event_loop()
    thread = threading.Thread(target=made.run_forever, daemon=True)
    thread.start()
    yield made
    made.call_soon_threadsafe(made.stop)
    thread.join()
    made.close()


@pytest.fixture(scope="session")
def jobs() -> Iterator[SolveJobs]:
    """A queue of fleets to plan, whose process takes seconds to start."""
    made = SolveJobs()
    yield made
    made.close()


@pytest.fixture(scope="session")
def routes() -> FastAPI:
    """The application, whose routes take a while to make."""
    return create_app()


@pytest.fixture
def serve(
    demo: RoutingProblem,
    tmp_path: Path,
    empty_database: bytes,
    loop: asyncio.AbstractEventLoop,
    routes: FastAPI,
) -> Iterator[Callable[..., Api]]:
    """Factory of APIs of the demo, with a database of their own.

    Give `tokens=True` for the tokens of `SECRETS`, `sockets=True` for a real server, and what of
    `Services` is to be another.
    """
    with ExitStack() as stack:

        def make(
            *,
            tokens: bool = False,
            sockets: bool = False,
            rate: RateLimit | None = None,
            **others: Any,
        ) -> Api:
            (tmp_path / "d.db").write_bytes(empty_database)
            url = f"sqlite:///{tmp_path}/d.db"
            settings = DispatcherSettings(
                solvers=("exact",), database_url=url, orders=OrderSettings(bundle_s=0.0)
            )
            database = stack.enter_context(open_database(url))
            solve = solve_in_process([ExactSolver()])
            path = tmp_path / "tokens.toml"
            write_tokens(path)
            server = stack.enter_context(ApiServer(0, path if tokens else None, rate))
            dispatcher = Dispatcher(
                settings,
                demo.network,
                demo.fleet,
                Bus(),
                database,
                solve,
                announce=server.events.publish,
            )
            reader = stack.enter_context(open_reader(url))
            watch = dispatcher.fleet_watch
            watched = stack.enter_context(
                AlarmSource(
                    dispatcher,
                    settings,
                    demo.network,
                    Bus(),
                    database,
                    server.events.publish,
                )
            )
            values: dict[str, Any] = {
                "settings": settings,
                "network": demo.network,
                "fleet": watch,
                "orders": OrderIntake(watch, database, reader, demo.network),
                "states": dispatcher.receiver.latest,
                "reader": reader,
                "alarms": watched.alarms,
                "control": dispatcher.control,
                "events": server.events,
                "solve_jobs": server.solve_jobs,
                "feeds": dispatcher.feeds,
                "is_live": lambda: True,
                "solver_fault": lambda: None,
                "checks": {"database": lambda: None},
            }
            services = Services(**{**values, **others})
            if sockets:
                server.start(services)
                return Api(server.port, dispatcher, services, watched, None, loop)
            routes.state.services = services
            app = Conventions(server.guarded(routes))
            return Api(0, dispatcher, services, watched, app, loop)

        yield make


def write_tokens(path: Path) -> None:
    """The tokens of `SECRETS` as a file."""
    path.write_text(
        "".join(
            f'[[tokens]]\nname = "{name}"\nsha256 = "{token_hash(name.encode())}"\n'
            f"scopes = {json.dumps(scopes)}\n"
            for name, scopes in SECRETS.items()
        )
    )
