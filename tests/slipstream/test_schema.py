"""Versions of messages: what is read, and what is refused."""

from __future__ import annotations

import pytest

from slipstream.errors import InputError
from slipstream.messages import ENCODING, SCHEMA, check_version, decode
from tests.slipstream.sent import a_report, a_state


def test_unknown_fields_are_refused_by_name() -> None:
    """Of a message of either kind."""
    for message in (a_state(), a_report()):
        payload = message.to_bytes()[:-1] + b',"of_a_later_version":1}'
        with pytest.raises(InputError, match=r"not a \w+: .*") as refused:
            decode(type(message), payload, "key")
        assert "of_a_later_version" in str(refused.value)


@pytest.mark.parametrize("version", [str(SCHEMA + 1), "0", "1.0", "", "x" * 99])
def test_another_version_is_refused_by_name(version: str) -> None:
    """In a short line that names both."""
    with pytest.raises(ValueError, match=f"where {SCHEMA} is read") as refused:
        check_version(f"application/json;version={version}")
    assert repr(version[:20]) in str(refused.value)
    assert len(str(refused.value)) < 80


@pytest.mark.parametrize("encoding", [ENCODING, "application/json", "zenoh/bytes", ""])
def test_the_own_version_and_none_are_read(encoding: str) -> None:
    """Other programs say none."""
    check_version(encoding)
