"""The road network."""

from __future__ import annotations

import gzip
import re
from importlib import resources
from pathlib import Path

import pytest

from slipstream.errors import InputError
from slipstream.roads import Segment, build_network
from slipstream.roads.sumo_net import load_network


def test_the_demo_network_is_whole() -> None:
    """Every segment has its way back, and its ends are junctions."""
    network = load_network("demo")
    assert len(network.segments) == 22
    for segment in network.segments.values():
        assert segment.start in network.junctions
        assert segment.end in network.junctions
        assert any(back.end == segment.start for back in network.leaving[segment.end])
        for following in network.follows[segment.id]:
            assert network.segments[following].start == segment.end


def test_a_truncated_archive_is_refused(tmp_path: Path) -> None:
    """A download that broke off is one line as well."""
    path = tmp_path / "x.net.xml.gz"
    path.write_bytes(gzip.compress(b"<net>" + b" " * 10_000)[:-10])
    with pytest.raises(InputError, match=r"x\.net\.xml\.gz"):
        load_network(path)


@pytest.mark.parametrize("content", [b"", b"not xml", b"<net></net>", b"<routes/>", b"\xff\x00"])
def test_what_is_no_sumo_net_is_refused(tmp_path: Path, content: bytes) -> None:
    """One clear line with the file's name."""
    path = tmp_path / "x.net.xml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"x\.net\.xml"):
        load_network(path)
    with pytest.raises(InputError, match="no such file"):
        load_network(tmp_path / "none.net.xml")


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"length_m": 0.0}, "length"),
        ({"length_m": float("nan")}, "length"),
        ({"speed_limit_mps": -1.0}, "speed"),
        ({"end": "nowhere"}, "unknown junction"),
    ],
)
def test_impossible_segments_are_refused(changes: dict[str, object], problem: str) -> None:
    """The segment is named."""
    fields: dict[str, object] = {
        "id": "ab",
        "start": "a",
        "end": "b",
        "length_m": 10.0,
        "speed_limit_mps": 10.0,
        "lanes": 1,
        "shape": ((0.0, 0.0), (10.0, 0.0)),
    }
    segment = Segment(**(fields | changes))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"ab: .*{problem}"):
        build_network("n", [segment], {"a": (0, 0), "b": (10, 0)})
    sound = Segment(**fields)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="two segments"):
        build_network("n", [sound, sound], {"a": (0, 0), "b": (10, 0)})


def test_signals_of_a_sumo_net_are_known(tmp_path: Path) -> None:
    """Junctions with traffic lights are told from the net; turns lead to segments only."""
    path = tmp_path / "lights.net.xml"
    demo = resources.files("slipstream").joinpath("data", "demo.net.xml").read_text()
    first = re.search(r'<junction id="(c\d)" type="priority"', demo)
    assert first is not None
    path.write_text(demo.replace(first[0], first[0].replace("priority", "traffic_light"), 1))
    assert load_network(path).signals == {first[1]}
    assert load_network("demo").signals == frozenset()


@pytest.mark.parametrize(
    ("follows", "problem"),
    [
        ({"ab": ("zz",)}, "ab: a turn names the unknown segment 'zz'; add it"),
        ({"zz": ()}, "zz: a turn names the unknown segment 'zz'; add it"),
        ({"ab": ("ab",)}, "ab: a turn onto 'ab', which begins elsewhere; remove the turn"),
    ],
)
def test_turns_must_lead_on(follows: dict[str, tuple[str, ...]], problem: str) -> None:
    """A turn joins two segments of the network, end to start."""
    segment = Segment("ab", "a", "b", 10.0, 10.0, 1, ((0.0, 0.0), (10.0, 0.0)))
    with pytest.raises(InputError, match=problem):
        build_network("n", [segment], {"a": (0, 0), "b": (10, 0)}, follows)


def test_ways_through_junctions_are_read() -> None:
    """Each allowed turn has a crossing; a turn is slower than its road."""
    network = load_network("demo")
    turns = {(a, b) for a, following in network.follows.items() for b in following}
    assert set(network.crossings) == turns
    crossing = network.crossings["avenue_east", "quay_link_east"]
    assert 5 < crossing.length_m < 20
    assert crossing.speed_mps < network.segments["avenue_east"].speed_limit_mps
    assert crossing.intersection is None
    assert not crossing.signal_groups


def test_junctions_are_in_the_order_of_the_segments() -> None:
    """Seeded draws go by it: the same whatever else of a net is read."""
    network = load_network("demo")
    ends = [name for segment in network.segments.values() for name in (segment.start, segment.end)]
    assert list(network.junctions) == list(dict.fromkeys(ends))


@pytest.mark.slow
def test_a_crossing_with_signals_names_its_groups() -> None:
    """Troy's: the signals that stand at the segment's end, and a number a lane."""
    from slipstream_lab.simulation.scenarios.scenario import load_scenario

    network = load_scenario("troy").network
    signalled = {pair: c for pair, c in network.crossings.items() if c.intersection is not None}
    assert len(signalled) > 100
    for (segment, following), crossing in signalled.items():
        assert network.segments[segment].end in network.signals
        assert network.segments[following].start == network.segments[segment].end
        assert crossing.signal_groups
        assert max(crossing.signal_groups) < network.segments[segment].lanes
        assert not crossing.yields
