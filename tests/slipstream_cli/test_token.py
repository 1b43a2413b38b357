from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest
from starlette.datastructures import Headers

from dispatcher_daemon.service.api.auth import TokenFile, identify
from slipstream_cli.main import main


def test_a_new_token_is_printed_once_and_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file has its hash alone and is its owner's; what was in it stays."""
    path = tmp_path / "tokens.toml"
    path.write_bytes(b"\xef\xbb\xbf# ours\r\n")
    path.chmod(0o640)
    for name, scopes in (("first", "read"), ("second", "read, control")):
        assert main(["token", "new", name, "--scopes", scopes, "--file", str(path)]) == 0
    first, second = capsys.readouterr().out.split()
    text = path.read_text()
    assert text.startswith("# ours\n")
    assert first not in text
    assert second not in text
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    client = identify(Headers({"authorization": f"Bearer {second}"}), TokenFile(path).current())
    assert (client.name, client.scopes) == ("second", frozenset({"read", "control"}))
    other = tmp_path / "other.toml"
    assert main(["token", "new", "a", "--scopes", "read", "--file", str(other)]) == 0
    assert stat.S_IMODE(other.stat().st_mode) == 0o600


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_the_file_stays_its_owners(tmp_path: Path) -> None:
    """Root adds a token, and the daemon whose file it is still reads it."""
    path = tmp_path / "tokens.toml"
    path.touch(0o600)
    os.chown(path, 1234, 2345)
    assert main(["token", "new", "a", "--scopes", "read", "--file", str(path)]) == 0
    found = path.stat()
    assert (found.st_uid, found.st_gid, stat.S_IMODE(found.st_mode)) == (1234, 2345, 0o600)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["first", "--scopes", "read"], "a token 'first' is there"),
        (["other", "--scopes", "read,all"], "scopes.1: 'all' is none of 'read', 'orders'"),
        (["", "--scopes", "read"], "name: "),
        (["other", "--scopes", "read", "--file", "/nowhere/tokens.toml"], "/nowhere/tokens.toml"),
    ],
)
def test_a_token_that_cannot_be_made_is_bad_input(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    said: str,
) -> None:
    """One line, status 2, and the file as it was."""
    monkeypatch.chdir(tmp_path)
    assert main(["token", "new", "first", "--scopes", "read"]) == 0
    before = (tmp_path / "api-tokens.toml").read_text()
    assert main(["token", "new", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert (tmp_path / "api-tokens.toml").read_text() == before
