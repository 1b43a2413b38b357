"""The clips: seeds and cameras that the detector's training has never seen."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from edge_daemon.camera import Camera, load_camera
from edge_daemon.offline import TrackResult, track
from edge_daemon.settings import TrackSettings
from slipstream_lab.simulation.ground_truth import Truth, load_truth

SECONDS: Final = 30
FPS: Final = 30


@dataclass(frozen=True)
class HeldOutClip:
    """One clip: its world, what goes on in it, and the seed of traffic, light and camera.

    SUMO's have a place, and the simulated second at which they begin; `options` are further ones of
    the command, by which its folder is known too.
    """

    world: str
    traffic: str
    seed: int
    rsu: str = ""
    begin_s: int = 120
    seconds: int = SECONDS
    fps: float = FPS
    options: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of its folder."""
        conditions = "".join(self.options).lstrip("-").replace("--", "-")
        rate = "" if self.fps == FPS else f"{self.fps:g}fps"
        parts = (self.world, self.traffic, self.rsu, str(self.seed), rate, conditions)
        return "-".join(filter(None, parts))

    @property
    def arguments(self) -> list[str]:
        """Arguments of `slipstream clip`."""
        options: dict[str, object] = {
            "--seconds": self.seconds,
            "--fps": self.fps,
            "--seed": self.seed,
        }
        if self.world == "sumo":
            options |= {
                "--routes": self.traffic,
                "--rsu": self.rsu,
                "--begin": self.begin_s,
            }
        else:
            options |= {"--scenario": self.traffic}
        words = (str(word) for option in options.items() for word in option)
        return [self.world, *words, *self.options]


# StreetDrive's seeds are those from 1000 up whose camera has both its height and its focal length
# in the bins that the training set leaves out (lab/slipstream_lab/simulation/training/scenes.py).
CLIPS: Final = (
    HeldOutClip("streetdrive", "mixed", 1022),
    HeldOutClip("streetdrive", "stable", 1031),
    HeldOutClip("streetdrive", "turbulent", 1033),
    HeldOutClip("streetdrive", "stable", 1044),
    HeldOutClip("streetdrive", "mixed", 1075),
    HeldOutClip("streetdrive", "turbulent", 1106),
    HeldOutClip("streetdrive", "stable", 1245),
    HeldOutClip("streetdrive", "turbulent", 1250),
    HeldOutClip("streetdrive", "paper", 1253),
    HeldOutClip("streetdrive", "stable", 1279),
    HeldOutClip("streetdrive", "turbulent", 1281),
    HeldOutClip("streetdrive", "mixed", 1282),
    HeldOutClip("sumo", "calm", 101, "approach"),
    HeldOutClip("sumo", "calm", 102, "opposite"),
    HeldOutClip("sumo", "calm", 103, "departure"),
    HeldOutClip("sumo", "calm", 104, "crossing"),
    HeldOutClip("sumo", "calm", 105, "bend"),
    HeldOutClip("sumo", "mixed", 301, "approach"),
    HeldOutClip("sumo", "mixed", 302, "opposite"),
    HeldOutClip("sumo", "mixed", 303, "departure", 132),
    HeldOutClip("sumo", "mixed", 305, "crossing", 104),
    HeldOutClip("sumo", "rough", 201, "approach", 180),
    HeldOutClip("sumo", "rough", 203, "departure"),
    HeldOutClip("sumo", "rough", 204, "crossing", 240),
)

# What is learned from truth (`make allowances`) is learned on these: other seeds and cameras than
# those of the clips that judge.
LEARNED_FROM: Final = (
    HeldOutClip("streetdrive", "stable", 1),
    HeldOutClip("streetdrive", "turbulent", 2),
    HeldOutClip("streetdrive", "mixed", 4, seconds=20, fps=45.6),
    HeldOutClip("streetdrive", "turbulent", 2000, seconds=20),
    HeldOutClip("streetdrive", "turbulent", 2001, seconds=20),
    HeldOutClip("streetdrive", "mixed", 2004, seconds=20),
    HeldOutClip("streetdrive", "turbulent", 2006, seconds=20),
    HeldOutClip("streetdrive", "paper", 2008, seconds=20),
    HeldOutClip("streetdrive", "stable", 2009, seconds=20),
    HeldOutClip("sumo", "rough", 401, "approach", 150, seconds=20),
    HeldOutClip("sumo", "rough", 402, "crossing", 170, seconds=20),
    HeldOutClip("sumo", "rough", 404, "departure", 200, seconds=20),
)


# One carriageway calm, the other stop-and-go: both answers can be wrong in each.
WEATHER: Final = {
    condition: tuple(
        HeldOutClip("streetdrive", "mixed", seed, seconds=20, fps=fps, options=options)
        for seed in (1022, 1282)
    )
    for condition, options, fps in (
        ("clear", (), FPS),
        ("15 frames/s", (), FPS / 2),
        ("rain, 10 mm/h", ("--rain", "10"), FPS),
        ("rain, 50 mm/h", ("--rain", "50"), FPS),
        ("snow, 2 mm/h", ("--snow", "2"), FPS),
        ("fog, 200 m", ("--visibility", "200"), FPS),
        ("fog, 80 m", ("--visibility", "80"), FPS),
        ("low sun", ("--low-sun",), FPS),
        ("night", ("--night",), FPS),
        ("night, rain 20 mm/h", ("--night", "--rain", "20"), FPS),
        ("drops on the lens", ("--dirt", "0.8"), FPS),
        ("blur of 20 ms", ("--exposure-ms", "20"), FPS),
    )
}
"""The same traffic and cameras, held-out ones, in all conditions."""


def make(folder: Path, clips: Sequence[HeldOutClip]) -> Iterator[tuple[HeldOutClip, Path]]:
    """Render what is not there yet, and hand on each clip with its folder."""
    for clip in clips:
        target = folder / clip.name
        if not (target / "camera.toml").is_file():
            command = [sys.executable, "-m", "slipstream_cli", "clip", *clip.arguments]
            subprocess.run([*command, "--out", str(target)], check=True, stdout=subprocess.DEVNULL)
        yield clip, target


class Followed(NamedTuple):
    """A clip that the edge's pipeline has followed, and what was true in it."""

    run: TrackResult
    truth: Truth
    camera: Camera


def follow(folder: Path, settings: TrackSettings) -> Followed:
    """Follow a clip that `make` has made."""
    camera = load_camera(folder / "camera.toml")
    run = track(folder / "video.mp4", camera, settings)
    return Followed(run, load_truth(folder / "truth.csv"), camera)
