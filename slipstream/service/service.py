"""Daemon services: signals, systemd notification and watchdog, logs, metrics, memory."""

from __future__ import annotations

import _thread
import ctypes
import logging
import os
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from types import FrameType
from typing import Final, Self, TypeVar

import psutil

from slipstream.config import ServiceSettings
from slipstream.errors import InputError
from slipstream.service.logs import JsonFormatter, log_uncaught
from slipstream.service.memory import TRIM_INTERVAL_S, trim_memory
from slipstream.service.status import serve_status
from slipstream.service.tracing import Tracing

log = logging.getLogger(__name__)
T = TypeVar("T")

WATCHDOG_S: Final = 60.0
"""Time without progress after which a daemon counts as hung where systemd gives none."""

SUPERVISED = "SLIPSTREAM_SUPERVISED"
"""Process id of `slipstream run`: what it starts ends with it, however it ends."""

_PR_SET_PDEATHSIG = 1
_OWN: Final = frozenset(
    {"dashboard", "dispatcher_daemon", "edge_daemon", "slipstream", "storage", "vehicle_agent"}
)


def configure_logging(name: str, settings: ServiceSettings) -> None:
    """Send log lines to standard error, stamped unless the journal or the supervisor does."""
    if settings.log_format == "json":
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(JsonFormatter(name))
        logging.basicConfig(level=settings.log_level, handlers=[handler], force=True)
        log_uncaught()
        return
    stamped = "JOURNAL_STREAM" not in os.environ and SUPERVISED not in os.environ
    logging.basicConfig(
        level=settings.log_level,
        format=("%(asctime)s " if stamped else "") + f"{name} %(levelname)s %(message)s",
        stream=sys.stderr,
        force=True,
    )


def notify(state: str) -> None:
    """Tell systemd, or `slipstream run` (sd_notify protocol); without a socket nothing happens."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sock:
            # A manager that does not read, itself stopped perhaps, must not hold up the work.
            sock.settimeout(1.0)
            sock.sendto(state.encode(), address)
    except OSError as error:
        log.warning("sd_notify: %s", error)


def die_with_parent(parent: int) -> None:
    """Have Linux end this process when its parent thread ends, however that happens.

    Args:
        parent: the parent's process id; if it has ended already, this process ends now.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    # Had it ended before, the kernel's signal would never come. Where a filter refuses to tell the
    # parent (-1), nothing would.
    if parent <= 0 or os.getppid() != parent:
        os._exit(1)


def follow_supervisor() -> None:
    """Tie this process to the supervisor that started it, if one did; call it first of all."""
    supervisor = os.environ.get(SUPERVISED)
    if supervisor is not None:
        die_with_parent(int(supervisor))


def rss_mb() -> float:
    """Resident memory of this process, MB (10^6 bytes)."""
    return float(psutil.Process().memory_info().rss) / 1e6


def set_from_handler(event: threading.Event) -> None:
    """Set an event in a signal's handler.

    `Event.set` itself could wait for ever there: the `Event.wait` that the signal interrupts may
    hold the event's lock.
    """
    _thread.start_new_thread(event.set, ())


class Service:
    """One daemon's life, and the owner of its parts; use it as a context manager around the main
    loop.

    Parts start in order and are stopped in reverse when it ends, however that comes: a part that
    does not start stops those that have. A thread that dies ends the service too, with status 1: a
    daemon that goes on without its receiver would look well.

    Attributes:
        stopping: set when SIGTERM or SIGINT has arrived.
        checks: what the daemon needs for its work, by name: why it does not have it now, in words;
            None: it has it. Asked by /readyz, from another thread.
        awaited: what a ready daemon has not heard since its start and may hear soon, in words by
            name; /readyz says it.
        vital: names of checks that /healthz asks too: without it a restart is due.
    """

    def __init__(self, name: str, settings: ServiceSettings) -> None:
        self.name = name
        self.stopping = threading.Event()
        self.checks: dict[str, Callable[[], str | None]] = {}
        self.awaited: Callable[[], Mapping[str, str]] = dict
        self.vital: set[str] = set()
        self._parts = ExitStack()
        self._waits_for: str | None = "starting"
        self._told = False
        self._settings = settings
        self._tracing = Tracing(name, settings.traces)
        self._watchdog_s = int(os.environ.get("WATCHDOG_USEC", "0")) / 1e6 / 4
        self._fed_at = 0.0
        self._progress_at: float | None = None
        self._trimmed_at = time.monotonic()
        self._previous: dict[int, object] = {}
        self._excepthook = threading.excepthook
        self._died: str | None = None

    def __enter__(self) -> Self:
        """Raises InputError if the metrics port is taken, or traces are asked for in vain."""
        for number in (signal.SIGTERM, signal.SIGINT):
            self._previous[number] = signal.signal(number, self._on_signal)
        self._excepthook, threading.excepthook = threading.excepthook, self._on_thread_fault
        port = self._settings.metrics_port
        if port:
            try:
                serve_status(port, self._fault, self._not_ready, self._ready)
            except OSError as error:
                raise InputError(
                    f"127.0.0.1:{port}",
                    f"cannot serve metrics: {error.strerror}",
                    "choose a free port",
                    key="service.metrics_port",
                ) from None
        self._tracing.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if not self._told:
            notify("STOPPING=1")
        try:
            self._parts.close()
        finally:
            threading.excepthook = self._excepthook
            self._tracing.__exit__()
            for number, handler in self._previous.items():
                signal.signal(number, handler)  # type: ignore[arg-type]
        if self._died is not None and kind is None:
            log.error("ended, as a thread died: %s", self._died)
            raise SystemExit(1)

    def start(
        self,
        name: str,
        make: Callable[[], AbstractContextManager[T]],
        check: Callable[[T], str | None] | None = None,
        *,
        vital: bool = False,
    ) -> T:
        """Start a part, which is stopped with the service.

        Args:
            name: of the part, and of its check.
            make: makes what starts on entering it, if not before, and stops on leaving it.
            check: why it does not do its work now, in words; None: it does.
            vital: whether /healthz asks it too.

        Returns:
            What entering it gives.
        """
        try:
            made = make()
            part = made.__enter__()
        except InputError:
            # Its line says what is wrong.
            raise
        except Exception as error:
            log.error("%s: does not start: %s", name, error)
            raise
        self.on_stop(name, partial(made.__exit__, None, None, None))
        if check is not None:
            self.checks[name] = partial(check, part)
            if vital:
                self.vital.add(name)
        return part

    def on_stop(self, name: str, stop: Callable[[], object]) -> None:
        """Have a part stopped that has started otherwise. One that fails to stop holds up none."""
        self._parts.callback(self._stop_part, name, stop)

    def _stop_part(self, name: str, stop: Callable[[], object]) -> None:
        try:
            stop()
        except Exception:
            log.exception("%s: does not stop in order", name)

    def _on_thread_fault(self, fault: threading.ExceptHookArgs) -> None:
        """A library's own thread may end as it likes."""
        self._excepthook(fault)
        frames = traceback.walk_tb(fault.exc_traceback)
        modules = {str(frame.f_globals.get("__name__")).partition(".")[0] for frame, _ in frames}
        if fault.exc_type is not SystemExit and not modules.isdisjoint(_OWN):
            name = "" if fault.thread is None else fault.thread.name
            self._died = self._died or f"{name}: {fault.exc_type.__name__}: {fault.exc_value}"
            self.stopping.set()

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        self._told = True
        notify("STOPPING=1")
        set_from_handler(self.stopping)

    def ready(self) -> None:
        """Notify systemd that the daemon is ready; from now on /readyz is answered by `checks`."""
        self._waits_for = None
        notify("READY=1")
        log.info("ready")

    def wait_for(self, what: str) -> None:
        """The daemon cannot work until `ready` is called, again perhaps: /readyz says so."""
        self._waits_for = what

    def progress(self, status: str | None = None) -> None:
        """Report progress of the pipeline; call it from the work itself, at any rate, between two
        pieces of it: twice a minute freed memory goes back to the system first.

        It feeds the watchdog of systemd or `slipstream run`: a stuck pipeline is restarted.

        Args:
            status: one line for ``systemctl status``.
        """
        now = time.monotonic()
        if now - self._trimmed_at >= TRIM_INTERVAL_S:
            trim_memory()
            self._trimmed_at = now
        self._progress_at = now
        if now - self._fed_at < (self._watchdog_s or 10.0):
            return
        self._fed_at = now
        notify("WATCHDOG=1" + (f"\nSTATUS={status}" if status else ""))

    def _fault(self) -> str | None:
        """Why the daemon does not work; None: it does."""
        return self._silence() or self._lacks(self.vital)

    def _silence(self) -> str | None:
        """Why the watchdog would not be fed; None: it is."""
        if self._progress_at is None:
            return "it has not begun to work yet"
        silent_s = time.monotonic() - self._progress_at
        limit_s = 4.0 * self._watchdog_s or WATCHDOG_S
        return f"no progress for {silent_s:.0f} s" if silent_s > limit_s else None

    def _not_ready(self) -> str | None:
        """Why the daemon cannot do its work now; None: it can."""
        waits_for = "stopping" if self.stopping.is_set() else self._waits_for or self._silence()
        return self._lacks(self.checks) if waits_for is None else waits_for

    def _ready(self) -> str:
        """What a daemon says that can do its work."""
        return "; ".join(["ready", *(f"{name}: {why}" for name, why in self.awaited().items())])

    def _lacks(self, names: Iterable[str]) -> str | None:
        """What it does not have of some checks, in words; None: it has all."""
        asked = ((name, self.checks[name]()) for name in names)
        return "; ".join(f"{name}: {why}" for name, why in asked if why is not None) or None

    def wait(self, seconds: float) -> bool:
        """Sleep, but wake up to stop; True if the daemon has to stop."""
        return self.stopping.wait(seconds)


class LogLimiter:
    """Lets one log line a minute through for each key and counts the suppressed ones."""

    def __init__(self, period_s: float = 60.0) -> None:
        self._period_s = period_s
        self._last: dict[str, float] = {}
        self._suppressed: dict[str, int] = {}

    def allow(self, key: str) -> bool:
        """True if a line for this key may be written now."""
        now = time.monotonic()
        if now - self._last.get(key, -1e9) < self._period_s:
            self._suppressed[key] = self._suppressed.get(key, 0) + 1
            return False
        self._last[key] = now
        return True

    def suppressed(self, key: str) -> int:
        """Number of lines suppressed since the last call, which resets it."""
        return self._suppressed.pop(key, 0)

    def warn(self, log: logging.Logger, key: str, line: str) -> None:
        """Log a warning unless one of this key was logged within the period."""
        if self.allow(key):
            more = self.suppressed(key)
            log.warning("%s%s", line, f" ({more} more of this kind)" if more else "")
