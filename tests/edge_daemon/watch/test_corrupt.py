"""Lost parts of a picture, beside views that are smooth or whose bit rate is low."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from edge_daemon.watch.background import Background
from edge_daemon.watch.faults.corrupt import CorruptJudge, repeated, repeated_share
from edge_daemon.watch.sample import Sample, sampled, small_grey
from edge_daemon.watch.trails import BareRoad

from .roads import EVERY_S, Picture, at

HEIGHT, WIDTH = 360, 640
ROAD = np.zeros((90, 160), np.bool_)
ROAD[40:] = True
Damage = Callable[[Picture], Picture]


def smooth(seed: int = 0) -> Picture:
    """A view without fine contrast through an encoder of a low bit rate: blocks of one colour."""
    down, across = np.mgrid[:HEIGHT, :WIDTH]
    slope = 60 + down / 4 + 30 * np.sin(across / 90)
    blocks = np.random.default_rng(seed).integers(0, 4, (HEIGHT // 20, WIDTH // 20))
    grey = slope // 6 * 6 + np.repeat(np.repeat(blocks, 20, 0), 20, 1)
    return np.repeat(grey[..., None], 3, 2).astype(np.uint8)


def detailed(seed: int = 0) -> Picture:
    """A view with noise."""
    return np.random.default_rng(seed).integers(60, 180, (HEIGHT, WIDTH, 3), dtype=np.uint8)


def judge(usual: float = 0.0) -> CorruptJudge:
    """One without a history."""
    small = small_grey(smooth())
    lanes = np.zeros(small.shape, np.bool_)
    return CorruptJudge(usual, ROAD, Background(), BareRoad(lanes, 0.5), lambda: False)


def said(
    watch: CorruptJudge, pictures: list[Picture], begin: int = 0, every_s: float = EVERY_S
) -> list[bool]:
    """What it says of each picture."""
    return [
        watch.look(Sample(at((begin + n) * every_s, each), begin + n))
        for n, each in enumerate(pictures)
    ]


def grey_below(share: float) -> Damage:
    """The decoder filled the lower part with grey."""

    def damage(picture: Picture) -> Picture:
        picture = picture.copy()
        picture[round(HEIGHT * (1 - share)) :] = 128
        return picture

    return damage


def streaked_down(picture: Picture) -> Picture:
    """The decoder repeated one row downwards."""
    picture = picture.copy()
    picture[150:] = picture[150]
    return picture


def streaked_aside(picture: Picture) -> Picture:
    """The decoder repeated one column to the right."""
    picture = picture.copy()
    picture[:, 320:] = picture[:, 320:321]
    return picture


@pytest.mark.slow
def test_a_smooth_view_is_not_corrupt() -> None:
    """Half of its neighbouring pixels agree, but in no run as long as a lost part's."""
    pictures = [smooth(number) for number in range(30)]
    assert min(repeated_share(sampled(each)) for each in pictures) > 0.4
    assert max(float(repeated(sampled(each)).mean()) for each in pictures) < 0.15
    assert not any(said(judge(), pictures))


@pytest.mark.parametrize("view", [smooth, detailed])
@pytest.mark.parametrize(
    "damage", [grey_below(0.5), grey_below(0.35), streaked_down, streaked_aside]
)
def test_lost_parts_are_told_for_as_long_as_they_last(
    view: Callable[[int], Picture], damage: Damage
) -> None:
    """From the second picture on, for minutes, with share and limit; and no longer."""
    watch = judge()
    views = [view(number) for number in range(10)]
    assert not any(said(watch, 3 * views, every_s=5.0))
    assert all(said(watch, 4 * [damage(each) for each in views], 30, every_s=5.0)[1:])
    assert "of the picture is flat or streaked, limit 0.2" in watch.detail
    assert not any(said(watch, views, 70, every_s=5.0))


def test_a_stream_that_is_corrupt_from_its_first_picture_on_is_noticed() -> None:
    """With a picture to compare it with or without: so much is flat in no healthy view."""
    torn = [grey_below(0.5)(detailed(number)) for number in range(10)]
    assert all(said(judge(), 3 * torn, every_s=5.0)[1:])
    assert all(said(judge(0.02), torn)[1:])


def masked(picture: Picture) -> Picture:
    """The houses behind the road are hidden for privacy, by a grey that never changes."""
    picture = picture.copy()
    picture[:150] = 100
    return picture


def test_a_mask_beside_the_road_is_not_unknown_for_good() -> None:
    """It becomes usual in a minute, at once with a picture to compare; losses are told still."""
    views = [masked(detailed(number)) for number in range(10)]
    watch = judge()
    heard = said(watch, 3 * views, every_s=5.0)
    assert heard[10]
    assert not any(heard[15:])
    assert said(watch, [grey_below(0.4)(each) for each in views], 30, every_s=5.0)[-1]
    assert not any(said(judge(float(repeated(sampled(views[0])).mean())), views))


@pytest.mark.slow
def test_an_encoder_that_is_set_anew_is_unusual_for_a_minute_only() -> None:
    """The view becomes smooth from one picture to the next, and stays so."""
    watch = judge()
    said(watch, 3 * [detailed(number) for number in range(10)])
    heard = said(watch, 16 * [smooth(number) for number in range(10)], 30)
    assert any(heard[:20])
    assert not any(heard[150:])


def test_short_damage_is_told_by_the_views_own_history() -> None:
    """What a decoder patches over in small pieces shows no long run."""
    watch = judge()
    said(watch, 3 * [detailed(number) for number in range(10)])

    def patched(picture: Picture) -> Picture:
        small = cv2.resize(picture, (WIDTH // 40, HEIGHT // 40), interpolation=cv2.INTER_NEAREST)
        wide = cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
        return np.asarray(wide, dtype=np.uint8)

    assert said(watch, [patched(detailed(number)) for number in range(3)], 30)[-1]
    assert "equal their neighbours, limit 0.3" in watch.detail
