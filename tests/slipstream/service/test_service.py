"""Life of a daemon."""

from __future__ import annotations

import http.client
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from slipstream.bus import free_port
from slipstream.config import ServiceSettings, check
from slipstream.errors import InputError
from slipstream.service import LogLimiter, Service, notify


def test_systemd_hears_ready_progress_and_stopping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The notifications go to the named socket, the watchdog's at most four times a period."""
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(path))
        receiver.settimeout(2)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        monkeypatch.setenv("WATCHDOG_USEC", "40000000")
        with Service("test", ServiceSettings()) as service:
            service.ready()
            service.progress("working")
            service.progress("working")
        heard = [receiver.recv(100).decode() for _ in range(3)]
    assert heard == ["READY=1", "WATCHDOG=1\nSTATUS=working", "STOPPING=1"]


def test_without_systemd_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    """No socket, no fault; a dead socket, no fault either."""
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/at/all")
    notify("READY=1")


def test_systemd_hears_of_the_stop_before_the_work_of_stopping(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal itself is answered, once."""
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(path))
        receiver.settimeout(2)
        monkeypatch.setenv("NOTIFY_SOCKET", str(path))
        with Service("test", ServiceSettings()):
            os.kill(os.getpid(), signal.SIGTERM)
            assert receiver.recv(100).decode() == "STOPPING=1"
        receiver.settimeout(0.2)
        with pytest.raises(TimeoutError):
            receiver.recv(100)


def test_sigterm_asks_the_daemon_to_stop() -> None:
    """The first signal sets `stopping`; the handlers are given back."""
    before = signal.getsignal(signal.SIGTERM)
    with Service("test", ServiceSettings()) as service:
        assert not service.wait(0.0)
        os.kill(os.getpid(), signal.SIGTERM)
        assert service.wait(2.0)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.timeout(60)
def test_a_signal_that_interrupts_the_wait_for_it_is_heard() -> None:
    """A wait holds the lock of its event for a moment; the handler must not ask for it."""
    with Service("test", ServiceSettings()) as service:
        with service.stopping._cond:
            os.kill(os.getpid(), signal.SIGTERM)
            assert not service.stopping.is_set()
        assert service.wait(30.0)


def test_a_taken_metrics_port_is_bad_input() -> None:
    """The line names the address and the key."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        settings = ServiceSettings(metrics_port=taken.getsockname()[1])
        with pytest.raises(InputError, match=r"service\.metrics_port"), Service("t", settings):
            pass


def test_metrics_are_served_on_loopback() -> None:
    """A scrape gets the process's figures."""
    import urllib.request

    port = free_port()
    with (
        Service("t", ServiceSettings(metrics_port=port)),
        urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer,
    ):
        assert b"process_resident_memory_bytes" in answer.read()


@pytest.mark.slow
def test_a_probe_sees_whether_the_work_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """/healthz is 503 before the first progress and after a watchdog's time without any; other
    paths than its own and the metrics' are not found.
    """
    monkeypatch.setenv("WATCHDOG_USEC", "400000")
    port = free_port()

    def status(path: str) -> int:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer.status

    def becomes(wanted: int, meanwhile: Callable[[], None] = lambda: None) -> bool:
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            meanwhile()
            if status("/healthz") == wanted:
                return True
            time.sleep(0.02)
        return False

    with Service("t", ServiceSettings(metrics_port=port)) as service:
        assert status("/healthz") == 503
        assert becomes(200, service.progress)
        assert [status(path) for path in ("/", "/metrics/x", "/readyz/x")] == [404] * 3
        assert becomes(503)


def test_readiness_names_what_the_daemon_waits_for() -> None:
    """While it starts, stands by or ends, and each thing that it lacks; HEAD has no body."""
    port = free_port()

    def probe(method: str = "GET") -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        connection.request(method, "/readyz")
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, text

    why: list[str | None] = ["no router answers"]
    with Service("t", ServiceSettings(metrics_port=port)) as service:
        service.progress()
        assert probe() == (503, "starting\n")
        service.ready()
        assert probe() == (200, "ready\n")
        assert probe("HEAD") == (200, "")
        service.checks |= {"bus": lambda: why[0], "database": lambda: why[0] and "there is none"}
        assert probe() == (503, "bus: no router answers; database: there is none\n")
        why[0] = None
        assert probe() == (200, "ready\n")
        service.awaited = lambda: {"rsus": "none heard yet"}
        assert probe() == (200, "ready; rsus: none heard yet\n")
        service.awaited = dict
        service.wait_for("standby")
        assert probe() == (503, "standby\n")
        service.ready()
        assert probe() == (200, "ready\n")
        service.stopping.set()
        assert probe() == (503, "stopping\n")


class Part:
    """Writes down when it starts and stops.

    Args:
        name: of it.
        life: of all parts.
        fault: that it does not start with.
        clings: whether it does not stop in order.
    """

    def __init__(
        self, name: str, life: list[str], fault: Exception | None = None, *, clings: bool = False
    ) -> None:
        self.name, self.life, self.fault, self.clings = name, life, fault, clings
        self.ill: str | None = None

    def __enter__(self) -> Part:
        if self.fault is not None:
            raise self.fault
        self.life.append(f"+{self.name}")
        return self

    def __exit__(self, *_: object) -> None:
        self.life.append(f"-{self.name}")
        if self.clings:
            raise RuntimeError("it hangs on")


def test_parts_stop_in_reverse_and_none_holds_up_another(caplog: pytest.LogCaptureFixture) -> None:
    """Those that were started otherwise too; one that does not stop in order is named."""
    life: list[str] = []
    with Service("t", ServiceSettings()) as service:
        service.start("a", lambda: Part("a", life))
        service.start("b", lambda: Part("b", life, clings=True))
        service.on_stop("c", lambda: life.append("-c"))
        service.start("d", lambda: Part("d", life))
    assert life == ["+a", "+b", "+d", "-d", "-c", "-b", "-a"]
    (record,) = caplog.records
    assert record.getMessage() == "b: does not stop in order"


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (OSError("no room"), ["c: does not start: no room"]),
        # The command says it in one line that names file, key and mend.
        (InputError("a.toml", "no bus", "start a router"), []),
    ],
)
def test_a_part_that_does_not_start_stops_those_that_have(
    fault: Exception, line: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    """One line names it; what comes after it is not started."""
    life: list[str] = []

    def run() -> None:
        with Service("t", ServiceSettings()) as service:
            for name in "abcd":
                own = fault if name == "c" else None
                service.start(name, partial(Part, name, life, own))

    with pytest.raises(type(fault)):
        run()
    assert life == ["+a", "+b", "-b", "-a"]
    assert [record.getMessage() for record in caplog.records] == line


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_dies_ends_the_daemon(caplog: pytest.LogCaptureFixture) -> None:
    """With status 1, so that it is started again; a library's thread may end as it likes."""
    before = threading.excepthook

    def serve() -> None:
        with Service("x", ServiceSettings()) as service:
            foreign = threading.Thread(target=int, args=("x",))
            foreign.start()
            foreign.join()
            assert not service.stopping.is_set()
            own = threading.Thread(target=check, args=(None, None, "x"), name="receiver")
            own.start()
            assert service.stopping.wait(60)
            own.join()

    with pytest.raises(SystemExit) as ended:
        serve()
    assert ended.value.code == 1
    assert "ended, as a thread died: receiver: " in caplog.text
    assert threading.excepthook is before


def test_each_part_says_how_it_is() -> None:
    """To /readyz all of them, to /healthz those without which a restart is due."""
    port = free_port()

    def probe(path: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        connection.request("GET", path)
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, text

    def ill(part: Part) -> str | None:
        return part.ill

    with Service("t", ServiceSettings(metrics_port=port)) as service:
        bus = service.start("bus", lambda: Part("bus", []), ill)
        solvers = service.start("solvers", lambda: Part("solvers", []), ill, vital=True)
        service.progress()
        service.ready()
        assert (probe("/readyz")[0], probe("/healthz")[0]) == (200, 200)
        bus.ill = "no router answers"
        assert probe("/readyz") == (503, "bus: no router answers\n")
        assert probe("/healthz") == (200, "live\n")
        solvers.ill = "none works"
        assert probe("/readyz") == (503, "bus: no router answers; solvers: none works\n")
        assert probe("/healthz") == (503, "solvers: none works\n")


@pytest.mark.process
def test_a_supervised_daemon_ends_with_its_supervisor() -> None:
    """Also when the supervisor is killed outright."""
    child = (
        "from slipstream.service import follow_supervisor; import time\n"
        "follow_supervisor(); print('up', flush=True); time.sleep(60)"
    )
    parent = (
        "import os, subprocess, sys, time\n"
        "os.environ['SLIPSTREAM_SUPERVISED'] = str(os.getpid())\n"
        f"p = subprocess.Popen([sys.executable, '-c', {child!r}], stdout=subprocess.PIPE)\n"
        "p.stdout.readline(); print(p.pid, flush=True); time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", parent],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    orphan = int(process.stdout.readline())
    process.kill()
    process.wait()
    process.stdout.close()
    deadline = time.monotonic() + 5
    while _runs(orphan) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _runs(orphan)


@pytest.mark.process
def test_a_daemon_whose_supervisor_is_gone_already_does_not_start() -> None:
    """A kill between fork and the kernel's promise leaves no orphan either."""
    result = subprocess.run(
        [
            *(sys.executable, "-c"),
            "from slipstream.service import follow_supervisor; follow_supervisor(); print('up')",
        ],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"SLIPSTREAM_SUPERVISED": "1"},
    )
    assert (result.returncode, result.stdout) == (1, "")


def _runs(pid: int) -> bool:
    try:
        return "zombie" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def test_the_limiter_lets_one_line_a_period_through() -> None:
    """What it held back is counted."""
    limiter = LogLimiter(period_s=60)
    assert [limiter.allow("a") for _ in range(3)] == [True, False, False]
    assert limiter.allow("b")
    assert limiter.suppressed("a") == 2
    assert limiter.suppressed("a") == 0
