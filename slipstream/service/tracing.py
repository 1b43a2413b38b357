"""Traces by OpenTelemetry, from picture to plan. Off unless `Tracing` is entered with an endpoint.

OpenTelemetry is imported only then. Its standard variables apply beside the endpoint: headers and
certificates (OTEL_EXPORTER_OTLP_*), sampling (OTEL_TRACES_SAMPLER), resources.
"""

from __future__ import annotations

import functools
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final, ParamSpec, Self, TypeVar

from slipstream.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")
Attribute = str | int | float | bool | Sequence[str]

MAX_SPARSE_SPANS: Final = 100
"""Spans of `sparse_span` in a second: more of them would crowd out the others in the exporter."""
_TIMEOUT_S: Final = 2.0
_SHUTDOWN_S: Final = 2.0
"""For the last spans, when a daemon stops."""
_QUIET_S: Final = 60.0

_OFF: Final[AbstractContextManager[None]] = nullcontext()
_tracer: Any = None
_second = 0
_in_second = 0


def span(
    name: str, began_ns: int | None = None, **attributes: Attribute
) -> AbstractContextManager[Any]:
    """A span around a block of code, inside the one that the thread is in.

    Args:
        began_ns: UTC at its begin; None: now.
    """
    return _OFF if _tracer is None else _start(name, attributes, began_ns)


def _start(
    name: str, attributes: Mapping[str, Attribute], began_ns: int | None = None
) -> AbstractContextManager[Any]:
    started: AbstractContextManager[Any] = _tracer.start_as_current_span(
        name, attributes=attributes, start_time=began_ns
    )
    return started


def sparse_span(name: str, **attributes: Attribute) -> AbstractContextManager[Any]:
    """As `span`, for what happens often: beyond `MAX_SPARSE_SPANS` a second there is none."""
    global _second, _in_second
    if _tracer is None:
        return _OFF
    now = int(time.monotonic())
    if now != _second:
        _second, _in_second = now, 0
    _in_second += 1
    return _start(name, attributes) if _in_second <= MAX_SPARSE_SPANS else _OFF


def is_on() -> bool:
    """Whether spans are recorded: for attributes that are costly to make."""
    return _tracer is not None


def note(**attributes: Attribute) -> None:
    """Add attributes to the span that the thread is in."""
    if _tracer is not None:
        from opentelemetry.trace import get_current_span

        get_current_span().set_attributes(attributes)


def traced(name: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """A function whose calls are spans."""

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            if _tracer is None:
                return function(*args, **kwargs)
            with span(name):
                return function(*args, **kwargs)

        return call

    return decorate


class Tracing:
    """Sends spans to a collector while it is entered.

    Args:
        endpoint: of the collector, OTLP over HTTP; None: no traces.
    """

    def __init__(self, service: str, endpoint: str | None) -> None:
        self._service, self._endpoint = service, endpoint
        self._provider: Any = None

    def __enter__(self) -> Self:
        """Raises InputError if OpenTelemetry is not installed, or does not take the endpoint."""
        global _tracer
        if self._endpoint is None:
            return self
        try:
            from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
            from opentelemetry.sdk.resources import Resource
            from opentelemetry.sdk.trace import TracerProvider
            from opentelemetry.sdk.trace.export import BatchSpanProcessor
        except ModuleNotFoundError:
            raise InputError(
                "service.traces",
                "traces need OpenTelemetry, which is not installed",
                "pip install 'slipstream[tracing]', or remove the key",
            ) from None
        resource = Resource.create({"service.name": f"slipstream-{self._service}"})
        exporter = OTLPSpanExporter(
            endpoint=f"{self._endpoint.rstrip('/')}/v1/traces", timeout=_TIMEOUT_S
        )
        self._provider = TracerProvider(resource=resource, shutdown_on_exit=False)
        self._provider.add_span_processor(BatchSpanProcessor(exporter))
        # A filter holds for its own logger only.
        logging.getLogger(OTLPSpanExporter.__module__).addFilter(_QUIET)
        _tracer = self._provider.get_tracer("slipstream")
        return self

    def __exit__(self, *_: object) -> None:
        global _tracer
        _tracer = None
        if self._provider is not None:
            # It tries a collector that is away again and again; a stop does not wait for that.
            ending = threading.Thread(
                target=self._provider.shutdown, name="traces end", daemon=True
            )
            ending.start()
            ending.join(_SHUTDOWN_S)
            self._provider = None


class _OneAMinute(logging.Filter):
    """A collector that is away is told once a minute, not with each batch."""

    def __init__(self) -> None:
        super().__init__()
        self._last = -1e9

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record is logged."""
        if record.created - self._last < _QUIET_S:
            return False
        self._last = record.created
        record.msg, record.args = f"traces: {record.getMessage()[:300]}", None
        record.exc_info = record.exc_text = None
        return True


_QUIET: Final = _OneAMinute()
