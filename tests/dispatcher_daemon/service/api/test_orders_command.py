"""`slipstream orders add|show|cancel|pin|release` against a served API."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from slipstream_cli.main import main

from .conftest import Api


@pytest.mark.slow
def test_orders_are_added_shown_and_cancelled(
    serve: Callable[..., Api],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From a file; a refusal is one line with its field, and exit status 2."""
    api, file = serve(tokens=True, sockets=True), tmp_path / "orders.json"
    where = ["--api", f"http://127.0.0.1:{api.port}"]
    monkeypatch.setenv("SLIPSTREAM_TOKEN", "orderer")
    file.write_text(json.dumps([{"id": "a/1", "node": "c2"}, {"id": "b", "node": "c4"}]))
    assert main(["orders", "add", str(file), *where]) == 0
    assert capsys.readouterr().out == "a/1  at c2\nb  at c4\n"
    assert main(["orders", "cancel", "b", *where]) == 0
    assert capsys.readouterr().out == "b  cancelled  cancelled by its caller\n"
    assert main(["orders", "add", str(file), *where]) == 0
    assert capsys.readouterr().out == "a/1  at c2\nb  at c4  cancelled\n"
    token = tmp_path / "token"
    token.write_text("reader\n")
    assert main(["orders", "show", "a/1", *where, "--token-file", str(token)]) == 0
    assert json.loads(capsys.readouterr().out)["state"] == "open"
    file.write_text(json.dumps({"id": "c", "node": "nowhere"}))
    assert main(["orders", "add", str(file), *where]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"slipstream: {file}: node: order 'c': no junction 'nowhere'")
    assert line.count("\n") == 1


@pytest.mark.slow
def test_orders_are_pinned_and_released(
    serve: Callable[..., Api],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For a vehicle, or for the one whose plan has it; a refusal is one line that names the key."""
    api, token = serve(tokens=True, sockets=True), tmp_path / "token"
    body = {"id": "a/1", "node": "c2"}
    assert api.ask("POST", "/v1/orders", "orderer", body).status == 201
    token.write_text("controller\n")
    where = ["a/1", "--api", f"http://127.0.0.1:{api.port}", "--token-file", str(token)]
    assert main(["orders", "pin", *where]) == 2
    assert "a/1: vehicle: order 'a/1': no vehicle has it yet" in capsys.readouterr().err
    assert main(["orders", "pin", *where, "--vehicle", "van-b"]) == 0
    assert capsys.readouterr().out == "a/1  open  pinned to van-b\n"
    assert main(["orders", "release", *where]) == 0
    assert capsys.readouterr().out == "a/1  open  released from van-b\n"
    api.dispatcher.run_cycle()
    assert main(["orders", "pin", *where]) == 0
    told = api.get("/v1/orders/a%2F1", "reader").json
    assert told["pinned"] == told["vehicle"] is not None
    assert main(["orders", "settle", *where, "--served"]) == 0
    assert capsys.readouterr().out.endswith("a/1  served  an operator says so\n")
    token.write_text("orderer\n")
    assert main(["orders", "release", *where]) == 2
    assert "has not the scope 'control'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("address", "problem"),
    [("127.0.0.1:80", "no address"), ("http://127.0.0.1:1", "no answer: "), ("http://[", "no add")],
)
def test_an_address_without_an_api_is_one_line(
    address: str, problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """And exit status 2."""
    assert main(["orders", "show", "a", "--api", address]) == 2
    assert problem in capsys.readouterr().err
