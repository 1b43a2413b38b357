"""A collector of traces on loopback: OTLP over HTTP."""

from __future__ import annotations

import gzip
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest


@dataclass(frozen=True)
class Span:
    """One span as it came."""

    service: str
    name: str
    trace: bytes
    id: bytes
    parent: bytes
    began_ns: int
    ended_ns: int
    attributes: dict[str, Any]


@dataclass
class Collector:
    """What has come."""

    endpoint: str
    spans: list[Span] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def wait_for(self, condition: Callable[[list[Span]], bool], seconds: float = 60.0) -> bool:
        """True once the condition holds."""
        with self.changed:
            return self.changed.wait_for(lambda: condition(self.spans), seconds)

    def tree(self, root: Span) -> dict[str, Any]:
        """Names of the spans below one, in the order of their begin."""
        inner = sorted(
            (span for span in self.spans if span.parent == root.id), key=lambda span: span.began_ns
        )
        return {span.name: self.tree(span) for span in inner}


def _value(value: Any) -> Any:
    kind = value.WhichOneof("value")
    found = getattr(value, kind)
    return [_value(each) for each in found.values] if kind == "array_value" else found


def _attributes(rows: Any) -> dict[str, Any]:
    return {row.key: _value(row.value) for row in rows}


@contextmanager
def collector() -> Iterator[Collector]:
    """A collector on a free port."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            if self.headers.get("Content-Encoding") == "gzip":
                body = gzip.decompress(body)
            assert self.path == "/v1/traces"
            with found.changed:
                for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
                    service = _attributes(resource.resource.attributes)["service.name"]
                    for scope in resource.scope_spans:
                        for row in scope.spans:
                            span = Span(
                                service,
                                row.name,
                                row.trace_id,
                                row.span_id,
                                row.parent_span_id,
                                row.start_time_unix_nano,
                                row.end_time_unix_nano,
                                _attributes(row.attributes),
                            )
                            found.spans.append(span)
                found.changed.notify_all()
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        found = Collector(f"http://127.0.0.1:{server.server_address[1]}")
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield found
        finally:
            server.shutdown()
            thread.join()
