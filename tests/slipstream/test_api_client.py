"""Calls of the dispatcher's HTTP API: what is sent, and what comes of any answer."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from slipstream.errors import InputError
from slipstream.http.client import ApiClient


class Handler(BaseHTTPRequestHandler):
    """Answers with what it was asked, or with what the path names."""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        asked = {
            "path": self.path,
            "token": self.headers.get("Authorization"),
            "body": json.loads(body) if body else None,
        }
        status, text = 200, json.dumps(asked).encode()
        if self.path.endswith("/refused"):
            status, text = 409, b'{"detail":"too late","mend":"wait"}'
        elif self.path.endswith("/list"):
            text = b"[1]"
        elif self.path.endswith("/page"):
            text = b"<html>"
        self.send_response(status)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def address() -> Iterator[str]:
    """A server that answers with what it was asked."""
    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/below/"
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_call_carries_body_and_token(address):
    """Below the address's path; without a body or token none is sent."""
    client = ApiClient(address, "--api")
    answer = client.call("POST", "/v1/orders", {"a": 1}, "secret")
    assert answer.status == 200
    assert answer.document == {
        "path": "/below/v1/orders",
        "token": "Bearer secret",
        "body": {"a": 1},
    }
    bare = client.call("POST", "/v1/x")
    assert (bare.document["token"], bare.document["body"]) == (None, None)


def test_a_refusal_is_an_answer(address):
    """Its status and document are the caller's to judge."""
    answer = ApiClient(address, "--api").call("POST", "/refused")
    assert (answer.status, answer.document["mend"]) == (409, "wait")


@pytest.mark.parametrize("path", ["/list", "/page"])
def test_what_is_no_object_is_no_dispatcher(address, path):
    """A page of another server is refused by name."""
    with pytest.raises(InputError, match="no API of a dispatcher"):
        ApiClient(address, "--api").call("POST", path)


def test_nobody_there_is_told():
    """One line with the mend."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        client = ApiClient(f"http://127.0.0.1:{taken.getsockname()[1]}", "--api")
        with pytest.raises(InputError, match=r"no answer: .*; start the dispatcher"):
            client.call("POST", "/v1/x", within_s=2.0)


@pytest.mark.parametrize("address", ["", "127.0.0.1:80", "ftp://a", "http://", "http://a:b"])
def test_an_address_is_checked(address):
    """Before anything is sent."""
    with pytest.raises(InputError, match="--api: no address"):
        ApiClient(address, "--api")
