from __future__ import annotations

from pathlib import Path

import pytest

from dispatcher_daemon.quantum.account import Account, read_account
from slipstream.errors import InputError


def test_the_token_comes_from_the_environment_and_is_never_shown() -> None:
    """Token and instance as set; no repr and no cleaned line has the token."""
    account = read_account({"QISKIT_IBM_TOKEN": " secret-1 ", "QISKIT_IBM_INSTANCE": "crn:1"})
    assert (account.token, account.instance) == ("secret-1", "crn:1")
    assert "secret-1" not in repr(account)
    assert account.clean("401 for secret-1") == "401 for ***"
    assert read_account({"QISKIT_IBM_TOKEN": "t"}).instance is None


def test_a_credential_of_systemd_goes_first(tmp_path: Path) -> None:
    """The unit's credential is taken, not what a shell may have left in the environment."""
    (tmp_path / "ibm-quantum-token").write_text("of-the-unit\n")
    environment = {"CREDENTIALS_DIRECTORY": str(tmp_path), "QISKIT_IBM_TOKEN": "of-a-shell"}
    assert read_account(environment) == Account("of-the-unit")
    (tmp_path / "ibm-quantum-instance").write_text("crn:2\n")
    assert read_account(environment).instance == "crn:2"


@pytest.mark.parametrize("content", [None, b"", b"\xff\xfe\xff"])
def test_no_credentials_are_one_clear_line(tmp_path: Path, content: bytes | None) -> None:
    """Nothing set, an empty or unreadable credential: the mend is named."""
    environment = {"CREDENTIALS_DIRECTORY": str(tmp_path)}
    if content is not None:
        (tmp_path / "ibm-quantum-token").write_bytes(content)
    with pytest.raises(InputError, match="credential"):
        read_account(environment)
    if content is None:
        with pytest.raises(InputError, match="QISKIT_IBM_TOKEN"):
            read_account({"QISKIT_IBM_TOKEN": "  "})
