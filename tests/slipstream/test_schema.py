"""Messages of other schema versions: what is read, left out, refused."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.errors import InputError
from slipstream.messages import SCHEMA, CycleReport, Gate, SegmentState, Unserved, decode
from slipstream.messages.base import UNKNOWN_FIELDS
from tests.slipstream.test_messages import a_report, a_state

MAJOR, MINOR = (int(part) for part in SCHEMA.split("."))
NEWER = st.integers(MINOR + 1, 999_999).map(lambda minor: f"{MAJOR}.{minor}")
OLDER = st.integers(0, MINOR).map(lambda minor: f"{MAJOR}.{minor}")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)
GATE = Gate(segment="s", y_e=None, reason="stale", age_s=9.0, speed_mps=None, open=False)
REPORT = a_report(Unserved(stop="a", reason="far"), Unserved(stop="b", reason="far")).model_copy(
    update={"gates": (GATE,)}
)
PLACES: tuple[tuple[str | int, ...], ...] = ((), ("unserved", 0), ("unserved", 1), ("gates", 0))


def counted() -> int:
    """Fields of cycle reports left out until now."""
    return int(UNKNOWN_FIELDS.labels("CycleReport")._value.get())


def with_fields(
    added: dict[tuple[str | int, ...], dict[str, Any]], version: str | None, *, first: bool = False
) -> bytes:
    """The report with unknown fields at some places, as a sender of a version sends it."""
    content = REPORT.model_dump(mode="json")
    for place, fields in added.items():
        inner: Any = content
        for part in place:
            inner = inner[part]
        inner.update({f"new_{name}": value for name, value in fields.items()})
    envelope = {} if version is None else {"schema": version}
    return json.dumps(envelope | content if first else content | envelope).encode()


FIELDS = st.dictionaries(
    st.sampled_from(PLACES), st.dictionaries(st.text(), JSON, min_size=1, max_size=3), min_size=1
)


@given(FIELDS, NEWER, st.booleans())
def test_a_newer_minor_version_is_read_as_far_as_known(
    added: dict[tuple[str | int, ...], dict[str, Any]], version: str, first: bool
) -> None:
    """Unknown fields at any depth are left out, each of them counted."""
    before = counted()
    assert decode(CycleReport, with_fields(added, version, first=first), "k") == REPORT
    assert counted() - before == sum(len(fields) for fields in added.values())


@pytest.mark.parametrize("place", [(), ("features",), ("features", "mean_speed_mps")])
def test_so_is_a_segments_state(place: tuple[str, ...]) -> None:
    """At any depth, too."""
    content = json.loads(a_state().to_bytes()) | {"schema": f"{MAJOR}.{MINOR + 1}"}
    inner = content
    for part in place:
        inner = inner[part]
    inner["new"] = {"a": 1}
    before = UNKNOWN_FIELDS.labels("SegmentState")._value.get()
    assert decode(SegmentState, json.dumps(content).encode(), "k") == a_state()
    assert UNKNOWN_FIELDS.labels("SegmentState")._value.get() == before + 1


@given(FIELDS, st.none() | OLDER)
def test_an_unknown_field_of_a_version_that_is_known_is_refused(
    added: dict[tuple[str | int, ...], dict[str, Any]], version: str | None
) -> None:
    """It is a mistake, not progress; so is one of a sender without a version."""
    with pytest.raises(InputError, match="new_"):
        decode(CycleReport, with_fields(added, version), "k")


@given(st.none() | OLDER | NEWER, st.booleans(), st.booleans())
def test_fields_that_an_older_sender_lacks_have_their_defaults(
    version: str | None, lacks: bool, first: bool
) -> None:
    """Of any minor version, wherever the version stands."""
    content = json.loads(with_fields({}, version, first=first))
    if lacks:
        del content["unserved"]
    expected = REPORT.model_copy(update={"unserved": ()}) if lacks else REPORT
    assert decode(CycleReport, json.dumps(content).encode(), "k") == expected


def test_what_we_send_says_its_version_only_above_the_first() -> None:
    """0.1.0 refuses the field; above 1.0 it is first, so that receivers look for nothing."""
    name, value = next(iter(json.loads(a_state().to_bytes()).items()))
    assert (name, value) == ("schema", SCHEMA) if MINOR else name != "schema"


@given(st.integers(0, 999_999).filter(lambda major: major != MAJOR), st.integers(0, 999_999))
def test_another_major_version_is_refused_by_name(major: int, minor: int) -> None:
    """One line names both versions."""
    content = json.loads(a_state().to_bytes()) | {"schema": f"{major}.{minor}"}
    with pytest.raises(InputError, match=rf"schema {major}\.{minor}, where {SCHEMA} is read"):
        decode(SegmentState, json.dumps(content).encode(), "k")


@pytest.mark.parametrize("version", [1, None, "", "1", "1.1.1", "v1.1", "01.1", "1.-1", [1, 1]])
def test_a_version_that_is_none_is_refused(version: object) -> None:
    """With the field's name."""
    content = json.loads(a_state().to_bytes()) | {"schema": version}
    with pytest.raises(InputError, match="schema: not a SegmentState: not a version"):
        decode(SegmentState, json.dumps(content).encode(), "k")


@pytest.mark.attack
def test_a_newer_version_excuses_nothing_else() -> None:
    """Wrong values, thousands of fields and broken JSON are refused as ever."""
    fields = json.loads(a_state().to_bytes())
    for content in (
        fields | {"schema": "1.999", "coverage": 2.0},
        fields | {"schema": "1.999", "coverage": 2.0, "surprise": 1},
        fields | {"schema": "1.999"} | {f"f{n}": n for n in range(2000)},
        {"schema": "1.999"},
        [{"schema": "1.999"}],
    ):
        with pytest.raises(InputError):
            decode(SegmentState, json.dumps(content).encode(), "k")
    for broken in (b'{"schema":"1.1",', b'{"schema":"1.1",}', b'{"schema"' + b"[" * 100_000):
        with pytest.raises(InputError):
            decode(SegmentState, broken, "k")
