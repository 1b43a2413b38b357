"""How each daemon reaches the router: over a pair of virtual cables, or over a TCP proxy.

Both can be cut so that nothing is told to either side, as a switch that dies cuts them. The proxy
can be slow and lossy besides: what a lost packet means to TCP is that its stream stands until it is
sent again.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import subprocess
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Protocol

NAMESPACE: Final = "slipstream-router"
_RETRANSMISSION_S: Final = (0.2, 1.0)
_CHUNK: Final = 65_536
_LOOK_S: Final = 0.02


class Link(Protocol):
    """A daemon's way to the router. `address`: where the daemon connects to."""

    address: tuple[str, int]

    def cut(self) -> None:
        """Let nothing through, without a word."""

    def mend(self) -> None:
        """Let everything through, what waited first."""

    def close(self) -> None:
        """Free what it has."""


class ProxyLink:
    """A TCP proxy on loopback. `delay_s` of each direction; `loss`: share of the pieces that wait
    for a retransmission.
    """

    def __init__(self, target: tuple[str, int]) -> None:
        self._target, self._chance = target, random.Random(1)
        self._is_cut, self.delay_s, self.loss = False, 0.0, 0.0
        self._loop = asyncio.new_event_loop()
        self._server = self._loop.run_until_complete(
            asyncio.start_server(self._serve, "127.0.0.1", 0)
        )
        host, port = self._server.sockets[0].getsockname()
        self.address: tuple[str, int] = (host, port)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def cut(self) -> None:
        """See `Link`."""
        self._is_cut = True

    def mend(self) -> None:
        """See `Link`."""
        self._is_cut, self.delay_s, self.loss = False, 0.0, 0.0

    def close(self) -> None:
        """See `Link`."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._server.close()
        for task in asyncio.all_tasks(self._loop):
            task.cancel()
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while self._is_cut:
            await asyncio.sleep(_LOOK_S)
        try:
            there, back = await asyncio.open_connection(*self._target)
        except OSError:
            writer.close()
            return
        ways = (self._pass_on(reader, back), self._pass_on(there, writer))
        await asyncio.gather(*ways, return_exceptions=True)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(1000)
        receiving = asyncio.ensure_future(self._receive(reader, waiting))
        try:
            while True:
                due_s, data = await waiting.get()
                while self._is_cut or self._loop.time() < due_s:
                    await asyncio.sleep(_LOOK_S)
                if not data:
                    break
                writer.write(data)
                await writer.drain()
        finally:
            receiving.cancel()
            writer.close()

    async def _receive(
        self, reader: asyncio.StreamReader, waiting: asyncio.Queue[tuple[float, bytes]]
    ) -> None:
        data = b"x"
        while data:
            try:
                data = await reader.read(_CHUNK)
            except OSError:
                data = b""
            late_s = self.delay_s
            if self._chance.random() < self.loss:
                late_s += self._chance.uniform(*_RETRANSMISSION_S)
            await waiting.put((self._loop.time() + late_s, data))


class CableLink:
    """A pair of virtual cables into the router's network namespace; cut at the router's end."""

    def __init__(self, number: int, port: int) -> None:
        self._far = f"far{number}"
        near, subnet = f"near{number}", f"10.77.{number}"
        self.address: tuple[str, int] = (f"{subnet}.2", port)
        _ip("link", "add", near, "type", "veth", "peer", "name", self._far, "netns", NAMESPACE)
        _ip("addr", "add", f"{subnet}.1/30", "dev", near)
        _ip("link", "set", near, "up")
        _ip("-n", NAMESPACE, "addr", "add", f"{subnet}.2/30", "dev", self._far)
        self.mend()

    def cut(self) -> None:
        """See `Link`."""
        _ip("-n", NAMESPACE, "link", "set", self._far, "down")

    def mend(self) -> None:
        """See `Link`."""
        _ip("-n", NAMESPACE, "link", "set", self._far, "up")

    def close(self) -> None:
        """See `Link`: it goes with the namespace."""


def open_namespace() -> str | None:
    """Make the router's network namespace in ours; returns why there can be none."""
    names = Path("/run/netns")
    try:
        # The names of namespaces are files: those of others' runs are none of ours.
        names.mkdir(exist_ok=True)
        _mount("-t", "tmpfs", "names", str(names))
        _ip("link", "set", "lo", "up")
        _ip("netns", "add", NAMESPACE)
        _ip("-n", NAMESPACE, "link", "set", "lo", "up")
    except FileNotFoundError:
        return "iproute2 is not installed"
    except subprocess.CalledProcessError as error:
        return f"no network namespaces: {error.stderr.strip()}"
    return None


def close_namespace() -> None:
    """Remove it and all cables into it."""
    with contextlib.suppress(OSError, subprocess.CalledProcessError):
        _ip("netns", "delete", NAMESPACE)


def write_router(path: Path, host: str, port: int) -> None:
    """Write a router's configuration: whoever reaches it is let in."""
    listen = f'endpoints: ["tcp/{host}:{port}"], exit_on_failure: true'
    path.write_text(
        f'{{ mode: "router", listen: {{ {listen} }}, '
        "scouting: { multicast: { enabled: false }, gossip: { enabled: false } }, "
        "timestamping: { enabled: true } }\n",
        encoding="utf-8",
    )


def endpoint(address: tuple[str, int]) -> str:
    """As zenoh writes it."""
    return f"tcp/{address[0]}:{address[1]}"


def close_all(links: Mapping[str, Link]) -> None:
    """Close several."""
    for link in links.values():
        link.close()


def _mount(*words: str) -> None:
    subprocess.run(["mount", *words], check=True, capture_output=True, text=True)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)
