"""A selection survives the way through a URL, and nothing else does."""

from __future__ import annotations

import contextlib
import http.client

import pytest
import viser
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from dashboard import selection
from dashboard.selection import MAX_ID_LENGTH, Selection
from dashboard.server import start_server, stop_server
from slipstream.bus import free_port

ODD = ("van-17", "a/b", "-12#3", "100%25", "~7E", "a+b c", "straße", "?x=1&select=y", "ü~%~")


@pytest.mark.parametrize("name", ODD, ids=range(len(ODD)))
def test_any_name_comes_back_from_its_path(name):
    """A path holds every name, in signs that no browser rewrites."""
    path = Selection("road", name).path()
    assert path.isascii()
    assert not set(path) & set("%#?+ &=")
    assert selection.of_path(path) == Selection("road", name)
    assert selection.of_path(path + "?websocket=ws://127.0.0.1:1/x") == Selection("road", name)


def test_a_query_names_a_selection():
    """What the operator's page writes is read, percent-encoded or not."""
    assert selection.of_query("/?select=van/van-1") == Selection("van", "van-1")
    assert selection.of_query("/?select=road/-12%233") == Selection("road", "-12#3")
    assert selection.of_query("/?select=rsu%2Fa%2Fb") == Selection("rsu", "a/b")


@pytest.mark.parametrize(
    "target",
    [
        "/",
        "/?select=",
        "/?select=van",
        "/?select=van/",
        "/?select=order/o-1",
        "/?select=van/a&select=van/b",
        f"/?select=van/{'x' * (MAX_ID_LENGTH + 1)}",
        "/?select=van/" + "%41" * 5000,
        "/?select=van/a%0d%0aSet-Cookie:%20x",
        "/?select=van/%00",
        "/?" + "a=1&" * 100 + "select=van/a",
        "/?select=van/%E2%80%AE",
        "//[?select=van/a",
    ],
    ids=range(13),
)
def test_other_queries_name_none(target):
    """Unknown kinds, long names, control signs and repeated keys are no selection."""
    assert selection.of_query(target) is None


@pytest.mark.parametrize(
    "path",
    [
        "/select/van/",
        "/select/order/x",
        "/select/van/~ff",
        "/select/van/~0d~0a",
        "/select/van/" + "x" * (MAX_ID_LENGTH + 1),
        "/Select/van/x",
        "/x/select/van/x",
    ],
    ids=range(7),
)
def test_other_paths_name_none(path):
    """A path that `path` does not write is no selection."""
    assert selection.of_path(path) is None


@pytest.fixture
def server():
    """A running server on a free port of loopback."""
    server = start_server("127.0.0.1", free_port())
    yield server
    stop_server(server)


def _get(port: int, path: str) -> tuple[int, str | None, bytes]:
    """Status, Location and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    with contextlib.closing(connection):
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.headers["Location"], answer.read()


def test_a_selection_is_redirected_to_its_page(server: viser.ViserServer):
    """The query leads to a path, relative for proxies, and there is the page; others as before."""
    port = server.get_port()
    assert _get(port, "/?select=road/-12%233")[:2] == (302, "select/road/-12~233")
    page = _get(port, "/select/road/-12~233")
    assert b"<html" in page[2][:200].lower()
    assert page == _get(port, "/?select=order/x") == _get(port, "/")
    assert _get(port, "/select/order/x")[0] == 404
    assert _get(port, "/other?select=van/x")[0] == 404


def test_a_connection_knows_its_selection(server: viser.ViserServer):
    """Two browsers with paths of their own each bring their own selection, another one none."""
    seen = []

    async def on_connect(client: viser.infra.WebsockClientConnection) -> None:
        seen.append(selection.asked_for.get())

    server._websock_server.on_client_connect(on_connect)
    protocol = [Subprotocol(f"viser-v{viser.__version__}")]
    for path in ("/select/van/a", "/select/rsu/b~2Fc", "", "/select/order/x"):
        url = f"ws://127.0.0.1:{server.get_port()}{path}"
        with connect(url, subprotocols=protocol, proxy=None, open_timeout=60) as socket:
            socket.recv(timeout=60)
    assert seen == [Selection("van", "a"), Selection("rsu", "b/c"), None, None]
