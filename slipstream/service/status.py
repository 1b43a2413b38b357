"""A daemon's metrics and probes over HTTP, on loopback."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from socketserver import ThreadingMixIn
from typing import TYPE_CHECKING
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import make_wsgi_app

if TYPE_CHECKING:
    from wsgiref.types import StartResponse, WSGIApplication, WSGIEnvironment


def serve_status(
    port: int,
    fault: Callable[[], str | None],
    not_ready: Callable[[], str | None],
    ready: Callable[[], str],
) -> None:
    """Serve /metrics for Prometheus, /healthz and /readyz for probes on 127.0.0.1, in a thread that
    ends with the process; all other paths are not found.

    Args:
        fault: why the daemon does not work, in words; None: it does.
        not_ready: why it cannot do its work now, likewise.
        ready: what it says where it can.

    Raises:
        OSError: the port cannot be bound.
    """
    metrics: WSGIApplication = make_wsgi_app()
    probes: dict[str, tuple[Callable[[], str | None], Callable[[], str]]] = {
        "/healthz": (fault, lambda: "live"),
        "/readyz": (not_ready, ready),
    }

    def page(environ: WSGIEnvironment, start_response: StartResponse) -> Iterable[bytes]:
        path = environ.get("PATH_INFO", "").rstrip("/")
        if path == "/metrics":
            body = metrics(environ, start_response)
        else:
            status, text = "404 Not Found", "here are /metrics, /healthz and /readyz"
            if path in probes:
                ask, sound = probes[path]
                problem = ask()
                status = "200 OK" if problem is None else "503 Service Unavailable"
                text = problem or sound()
            start_response(status, [("Content-Type", "text/plain; charset=utf-8")])
            body = [f"{text}\n".encode()]
        return () if environ.get("REQUEST_METHOD") == "HEAD" else body

    server = make_server("127.0.0.1", port, page, _ThreadingServer, _SilentHandler)
    threading.Thread(target=server.serve_forever, name="status", daemon=True).start()


class _ThreadingServer(ThreadingMixIn, WSGIServer):
    daemon_threads = True


class _SilentHandler(WSGIRequestHandler):
    timeout = 30.0

    def log_message(self, format: str, *args: object) -> None:
        """Scrapes are not logged."""
