"""Tests of which pictures of a live stream are told to be old."""

from __future__ import annotations

from itertools import accumulate

import pytest

from edge_daemon.sources.backlog import Arrival, Backlog

FRAME_S = 1 / 30
LIVE = Arrival(old=False, cut=False)
OLD = Arrival(old=True, cut=False)
CUT = Arrival(old=False, cut=True)


def _arrivals(steps_s: list[float], stamps_s: list[float] | None = None) -> list[Arrival]:
    backlog = Backlog()
    times_s = list(accumulate(steps_s, initial=100.0))
    stamps = [None] * len(times_s) if stamps_s is None else stamps_s
    return [backlog.classify(t, s) for t, s in zip(times_s, stamps, strict=True)]


@pytest.mark.parametrize("decoding_s", [0.0005, 0.003, 0.006, 0.015])
def test_all_that_piled_up_in_a_silence_is_old(decoding_s: float) -> None:
    """However long decoding them takes, none but the first passes, nor does its time."""
    told = _arrivals([*[FRAME_S] * 10, 1.0, *[decoding_s] * 30, *[FRAME_S] * 5])
    assert told == [*[LIVE] * 11, CUT, *[OLD] * 30, CUT, *[LIVE] * 4]


def test_a_silence_without_a_backlog_costs_no_picture() -> None:
    """A camera that was dark for a second goes on where it is."""
    told = _arrivals([*[FRAME_S] * 10, 1.0, *[FRAME_S] * 5])
    assert told == [*[LIVE] * 11, CUT, *[LIVE] * 5]


def test_jitter_without_a_silence_costs_no_picture() -> None:
    """A reader that was late by most of an interval has the next picture soon after."""
    told = _arrivals([FRAME_S, FRAME_S, 1.8 * FRAME_S, 0.2 * FRAME_S, FRAME_S])
    assert told == [LIVE] * 6


def test_a_slow_camera_is_no_silence_of_its_own() -> None:
    """Of one that sends a picture a second each passes, cut from the one before."""
    assert _arrivals([1.0] * 5) == [LIVE, *[CUT] * 5]


def test_a_camera_that_comes_back_at_another_rate_is_believed() -> None:
    """Three times as fast after a silence, its pictures pass once they kept the new distance."""
    told = _arrivals([*[0.1] * 5, 1.0, *[FRAME_S] * 60])
    assert told[-1] == LIVE
    assert sum(t.old for t in told) <= 30


def test_time_stamps_say_what_is_old() -> None:
    """ImagePool that come twice as fast as they were taken piled up; their times are right."""
    stamps = [n * FRAME_S for n in range(36)]
    told = _arrivals([*[FRAME_S] * 5, 0.8, *[0.01] * 24, *[FRAME_S] * 5], stamps)
    assert told == [OLD, *[LIVE] * 5, CUT, *[OLD] * 24, *[LIVE] * 5]
