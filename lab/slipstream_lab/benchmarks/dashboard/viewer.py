"""Browsers that follow the operator's page: what they get, and how late."""

from __future__ import annotations

import json
import socket
import statistics
import threading
import time
import zlib
from dataclasses import dataclass, field
from typing import Any, Final

_KINDS = ("moment", "delta")
_OPENINGS: Final = 5


@dataclass
class StreamViewer:
    """One browser's stream, read by a thread of its own.

    Attributes:
        first_s: from the request to the first moment, s; None: it has not come.
        seen: UTC at which each of the probe's numbers was shown, s.
    """

    port: int
    probe: str
    first_s: float | None = None
    received: int = 0
    events: int = 0
    seen: dict[int, float] = field(default_factory=dict)

    def start(self) -> None:
        """Follow until the process ends."""
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        begun, unpack, text = time.monotonic(), zlib.decompressobj(zlib.MAX_WBITS | 16), b""
        with socket.create_connection(("127.0.0.1", self.port), timeout=60) as connection:
            connection.sendall(
                b"GET /api/live HTTP/1.1\r\nHost: localhost\r\nAccept-Encoding: gzip\r\n\r\n"
            )
            file = connection.makefile("rb")
            while file.readline() not in (b"\r\n", b""):
                pass
            while size := int(file.readline() or b"0", 16):
                chunk = file.read(size + 2)[:-2]
                self.received += len(chunk)
                text += unpack.decompress(chunk)
                *blocks, text = text.split(b"\n\n")
                for block in blocks:
                    self._take(block, begun)

    def _take(self, block: bytes, begun: float) -> None:
        fields = dict(line.partition(b": ")[::2] for line in block.split(b"\n"))
        if fields.get(b"event", b"").decode() not in _KINDS:
            return
        now, data = time.time(), json.loads(fields[b"data"])
        self.events += 1
        if self.first_s is None:
            self.first_s = time.monotonic() - begun
        # The moment shows a state that may be old already.
        tables: dict[str, Any] = data.get("set", {})
        number = tables.get("roads", {}).get(self.probe, {}).get("vehicles")
        if number is not None:
            self.seen.setdefault(number, now)


def first_paint_s(address: str) -> float | None:
    """From the request to the first content in a Chromium that runs already, s.

    The median of `_OPENINGS`, each with an empty cache; None: there is no Chromium.
    """
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    import shutil

    path = shutil.which("chromium")
    if path is None:
        return None
    arguments = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
    painted = "performance.getEntriesByName('first-contentful-paint')"
    found = []
    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=path, args=arguments)
        try:
            for _ in range(_OPENINGS):
                context = browser.new_context(
                    viewport={"width": 1440, "height": 900}, bypass_csp=True
                )
                page = context.new_page()
                # The browser's own start is no part of it.
                page.goto("about:blank")
                page.goto(address, wait_until="commit")
                page.wait_for_function(f"{painted}.length > 0", timeout=60_000)
                found.append(float(page.evaluate(f"{painted}[0].startTime")) / 1000)
                context.close()
        finally:
            browser.close()
    return statistics.median(found)
