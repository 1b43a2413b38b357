"""A bare page with nothing but the operator's map, served from a temporary folder."""

from __future__ import annotations

import functools
import http.server
import json
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MAP = Path(__file__).parents[4] / "dashboard/web/static/map"
PAGE = Path(__file__).with_name("map_page.html")
WAIT_MS = 120_000
"""A shared machine may give the browser a tenth of a core."""

OpenMap = Callable[..., Any]


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


@contextmanager
def map_pages(browser: Any) -> Iterator[OpenMap]:
    """A function that opens a page with a map of a network at a moment.

    Its keyword arguments are ``width`` and ``height`` in px, ``query`` of the page's address and
    further options of the browser's context.
    """
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        shutil.copytree(MAP, root / "map")
        shutil.copy(PAGE, root / "index.html")
        handler = functools.partial(_Quiet, directory=folder)
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()

        def open_map(
            network: dict[str, Any],
            moment: dict[str, Any],
            query: str = "still&theme=light",
            width: int = 1000,
            height: int = 700,
            **options: Any,
        ) -> Any:
            (root / "network.json").write_text(json.dumps(network))
            (root / "moment.json").write_text(json.dumps(moment))
            size = {"width": width, "height": height}
            page = browser.new_context(viewport=size, **options).new_page()
            page.set_default_timeout(WAIT_MS)
            page.on("pageerror", lambda error: page.errors.append(str(error)))
            page.errors = []
            page.goto(f"http://127.0.0.1:{server.server_port}/?{query}")
            page.wait_for_function("window.ready && window.map.at(0, 0) !== undefined")
            page.wait_for_function("document.querySelector('.map-scale').textContent !== ''")
            return page

        try:
            yield open_map
        finally:
            server.shutdown()
            thread.join()
            server.server_close()
