from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest

from dispatcher_daemon.service.api import create_app
from dispatcher_daemon.service.api.auth import TokenFile
from slipstream.errors import InputError

from .conftest import SECRETS, Api, write_tokens

NEEDS = {
    ("GET", "/v1/vehicles"): "read",
    ("GET", "/v1/vehicles/{vehicle}"): "read",
    ("POST", "/v1/vehicles/{vehicle}/position"): "vehicles",
    ("POST", "/v1/vehicles/{vehicle}/acknowledgement"): "vehicles",
    ("POST", "/v1/vehicles/{vehicle}/progress"): "vehicles",
    ("GET", "/v1/plans/{vehicle}"): "read",
    ("GET", "/v1/cycles"): "read",
    ("GET", "/v1/cycles/{number}"): "read",
    ("GET", "/v1/cycles/{number}/explain"): "read",
    ("GET", "/v1/energy"): "read",
    ("GET", "/v1/segments"): "read",
    ("GET", "/v1/segments/{segment}"): "read",
    ("GET", "/v1/feeds/datex2/sites"): "read",
    ("GET", "/v1/feeds/datex2/measured"): "read",
    ("GET", "/v1/feeds/datex2/extension.xsd"): "read",
    ("GET", "/v1/feeds/wzdx"): "read",
    ("GET", "/v1/events"): "read",
    ("POST", "/v1/orders"): "orders",
    ("GET", "/v1/orders"): "read",
    ("GET", "/v1/orders/{order}"): "read",
    ("DELETE", "/v1/orders/{order}"): "orders",
    ("POST", "/v1/orders/{order}/pin"): "control",
    ("POST", "/v1/orders/{order}/release"): "control",
    ("POST", "/v1/orders/{order}/settle"): "control",
    ("POST", "/v1/solve"): "control",
    ("GET", "/v1/solve/{job}"): "control",
    ("DELETE", "/v1/solve/{job}"): "control",
    ("POST", "/v1/vroom"): "control",
    ("GET", "/v1/alarms"): "read",
    ("POST", "/v1/alarms/{alarm}/acknowledge"): "control",
    ("GET", "/v1/log"): "read",
    ("POST", "/v1/control/pause"): "control",
    ("POST", "/v1/control/resume"): "control",
    ("POST", "/v1/control/cycle"): "control",
    ("GET", "/healthz"): None,
    ("GET", "/readyz"): None,
    ("GET", "/metrics"): None,
}
"""Scope that an operation needs; None: none. A new operation has to be put in."""


def _status(api: Api, operation: tuple[str, str], token: str | None) -> int:
    method, path = operation
    for name in ("{vehicle}", "{segment}", "{job}", "{number}", "{order}", "{alarm}"):
        path = path.replace(name, "0")
    # Too long: where it counts, the operation ends with 422 after the caller was let in.
    return api.ask(method, path, token, headers={"Last-Event-ID": "x" * 101}).status


@pytest.mark.slow
def test_each_operation_wants_its_scope(serve: Callable[..., Api]) -> None:
    """401 without a token or with an unknown one, 403 with one of other scopes, else neither."""
    paths = create_app().openapi()["paths"]
    assert {(m.upper(), path) for path, methods in paths.items() for m in methods} == set(NEEDS)
    api = serve(tokens=True)
    for operation, token in itertools.product(NEEDS, [None, "unknown", *SECRETS]):
        needed, status = NEEDS[operation], _status(api, operation, token)
        if needed is None or needed in SECRETS.get(token or "", ()):
            assert status not in (401, 403), (operation, token)
        else:
            assert status == (403 if token in SECRETS else 401), (operation, token)


def test_without_tokens_only_this_machine_reads(serve: Callable[..., Api]) -> None:
    """What a proxy sends on, or asks for under another name, is refused, and so is all but GET."""
    api = serve()
    assert api.get("/v1/vehicles").status == 200
    for headers in ({"X-Forwarded-For": "192.0.2.1"}, {"Host": "rebound.example"}, {"Host": "["}):
        assert api.ask("GET", "/v1/vehicles", headers=headers).status == 401, headers
    assert api.ask("POST", "/v1/solve", body={}).status == 401
    assert api.get("/v1/vehicles", token="reader").status == 401


def test_a_header_that_is_no_token_is_refused(serve: Callable[..., Api]) -> None:
    """Each is a 401 that says what to send."""
    api = serve(tokens=True)
    for header in ("reader", "Basic reader", "Bearer", "Bearer ", "Bearer reader x", "Bearer \xff"):
        answer = api.ask("GET", "/v1/vehicles", headers={"Authorization": header})
        assert answer.status == 401, header
        assert answer.headers["www-authenticate"].startswith("Bearer")
        assert answer.json["field"] == "Authorization"
        assert "slipstream token new" in answer.json["mend"]


def test_a_withdrawn_token_counts_no_more(serve: Callable[..., Api], tmp_path: Path) -> None:
    """The file is read again when it changes; one that is faulty then has no token at all."""
    api, path = serve(tokens=True), tmp_path / "tokens.toml"
    assert api.get("/v1/vehicles", "reader").status == 200
    path.write_text(path.read_text().partition('[[tokens]]\nname = "orderer"')[2])
    assert api.get("/v1/vehicles", "reader").status == 401
    write_tokens(path)
    assert api.get("/v1/vehicles", "reader").status == 200
    path.unlink()
    assert api.get("/v1/vehicles", "reader").status == 401


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('[[tokens]]\nname = "a"\nsha256 = "00"\nscopes = ["read"]', "tokens.0.sha256"),
        (f'[[tokens]]\nname = "a"\nsha256 = "{"0" * 64}"\nscopes = ["all"]', "tokens.0.scopes.0"),
        (f'[[tokens]]\nname = "a"\nsha256 = "{"0" * 64}"\nscopes = []', "tokens.0.scopes"),
        (2 * f'[[tokens]]\nname = "a"\nsha256 = "{"0" * 64}"\nscopes = ["read"]\n', "2 tokens"),
    ],
)
def test_a_faulty_file_of_tokens_is_named(tmp_path: Path, text: str, key: str) -> None:
    """At the start it is bad input, with the key."""
    path = tmp_path / "tokens.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=key):
        TokenFile(path)
