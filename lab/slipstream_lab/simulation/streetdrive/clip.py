"""Renders a StreetDrive clip: video, ground truth and calibration in one folder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from slipstream_lab.simulation.streetdrive.calibration import camera_toml
from slipstream_lab.simulation.streetdrive.rendering import (
    Codec,
    Density,
    Image,
    Lens,
    Mesh,
    Palette,
    PinholeCamera,
    PlacedMesh,
    Seen,
    Sensor,
    SensorSettings,
    Stage,
    draw_light,
)
from slipstream_lab.simulation.streetdrive.settings import ClipSettings
from slipstream_lab.simulation.streetdrive.traffic import Road, VehicleTrack, simulate
from slipstream_lab.simulation.streetdrive.vehicles import CLASS_OF_SHAPE, build_vehicle
from slipstream_lab.simulation.streetdrive.writer import (
    TRUTH_COLUMNS,
    ClipSummary,
    Progress,
    make_folder,
    write_clip,
)

__all__ = [
    "TRUTH_COLUMNS",
    "ClipFleet",
    "ClipRenderer",
    "ClipSettings",
    "ClipSummary",
    "render_clip",
]

_SHAPE_SHARES = {
    "saloon": 0.27,
    "hatch": 0.22,
    "suv": 0.19,
    "van": 0.12,
    "truck": 0.07,
    "lorry": 0.04,
    "bus": 0.04,
    "motorcycle": 0.05,
}
PALETTE = Palette(
    asphalt=(112.0, 111.0, 110.0),
    verge=(66.0, 112.0, 100.0),
    pavement=(160.0, 166.0, 170.0),
    foliage=(46.0, 96.0, 70.0),
)


class ClipFleet:
    """The meshes of a clip's vehicles, built when first asked for; number and seed decide each."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._meshes: dict[int, Mesh] = {}
        self._sway_m: dict[int, float] = {}

    def mesh(self, vehicle_id: int) -> Mesh:
        """The vehicle's mesh."""
        if vehicle_id not in self._meshes:
            rng = np.random.default_rng([self._seed, 2, vehicle_id])
            shapes = tuple(_SHAPE_SHARES)
            shape = shapes[int(rng.choice(len(shapes), p=list(_SHAPE_SHARES.values())))]
            self._meshes[vehicle_id] = build_vehicle(shape, rng)
        return self._meshes[vehicle_id]

    def length_m(self, vehicle_id: int) -> float:
        """The vehicle's length in metres."""
        return self.mesh(vehicle_id).length_m

    def sway_m(self, vehicle_id: int) -> float:
        """How far the vehicle keeps from its lane's centre line, in metres."""
        if vehicle_id not in self._sway_m:
            rng = np.random.default_rng([self._seed, 3, vehicle_id])
            self._sway_m[vehicle_id] = float(rng.uniform(-0.25, 0.25))
        return self._sway_m[vehicle_id]


def draw_clip_camera(rng: np.random.Generator, road: Road) -> PinholeCamera:
    """A pole beside the incoming lanes that sees both directions from 13 m to the horizon."""
    height, focal = float(rng.uniform(9.5, 11.5)), float(rng.uniform(960, 1100))
    lateral = road.left_edge_m + float(rng.uniform(0.3, 1.6))
    horizon = float(rng.uniform(55, 95))
    return PinholeCamera(
        height_m=height,
        lateral_m=lateral,
        pitch_rad=math.atan((360.0 - horizon) / focal),
        yaw_rad=math.atan2(-lateral, float(rng.uniform(36, 46))),
        focal_px=focal,
        roll_rad=math.radians(float(rng.uniform(-0.6, 0.6))),
    )


def _frames(tracks: list[VehicleTrack], frames: int) -> Iterator[list[tuple[VehicleTrack, int]]]:
    """For each frame the tracks that exist in it, with the index of their sample."""
    for frame in range(frames):
        yield [
            (track, frame - track.first_frame)
            for track in tracks
            if 0 <= frame - track.first_frame < len(track.x_m)
        ]


def _truth_row(
    frame: int, fps: float, track: VehicleTrack, sample: int, placed: PlacedMesh, seen: Seen
) -> list[str]:
    box = (f"{value:.2f}" for value in seen.box_px)
    return [
        str(frame),
        f"{frame / fps:.6f}",
        str(track.vehicle_id),
        CLASS_OF_SHAPE[placed.mesh.kind],
        f"{placed.x_m:.4f}",
        f"{placed.y_m:.4f}",
        f"{track.speed_mps[sample]:.4f}",
        f"{track.acceleration_mps2[sample]:.4f}",
        *box,
        f"{seen.visible_fraction:.3f}",
        f"{placed.mesh.length_m:.3f}",
        f"{placed.mesh.width_m:.3f}",
    ]


class ClipRenderer:
    """One clip's world: iterate over `frames` to get picture and truth rows of each frame."""

    def __init__(self, settings: ClipSettings) -> None:
        self.settings = settings
        self.road = Road()
        rng = np.random.default_rng([settings.seed, 0])
        self.camera = draw_clip_camera(rng, self.road)
        self._fleet = ClipFleet(settings.seed)
        light = draw_light(rng).exposed(float(rng.uniform(1.12, 1.25)))
        given = settings.conditions
        # A generator of its own: camera and traffic stay the same in any weather.
        weather = np.random.default_rng([settings.seed, 4])
        self._stage = Stage(
            self.camera,
            self.road,
            light,
            PALETTE,
            rng,
            density=Density(7.0, 14.0, 5.0),
            conditions=given,
            weather=weather,
        )
        blur, vignette, noise = (float(v) for v in rng.uniform((0.4, 0.1, 1.5), (0.7, 0.25, 3.0)))
        if given.night:
            noise += float(weather.uniform(3.0, 6.0))
        self._lens = Lens(given, self.camera, self._stage.light, weather)
        self._codec = Codec(given.jpeg_quality)
        self._sensor = Sensor(
            SensorSettings(blur, vignette, noise),
            self.camera.width_px,
            self.camera.height_px,
            rng,
        )
        self._tracks = simulate(
            settings.scenario,
            self.road,
            seconds=settings.frames / settings.fps,
            fps=settings.fps,
            seed=settings.seed,
            length_of=self._fleet.length_m,
        )

    def frames(self) -> Iterator[tuple[Image, list[list[str]]]]:
        """Pictures (720, 1280, 3) BGR with their truth rows in the order of TRUTH_COLUMNS."""
        settings = self.settings
        for frame, present in enumerate(_frames(self._tracks, settings.frames)):
            placed = [
                PlacedMesh(
                    self._fleet.mesh(track.vehicle_id),
                    float(track.x_m[sample]),
                    track.lane.y_m + self._fleet.sway_m(track.vehicle_id),
                    track.lane.direction,
                    speed_mps=float(track.speed_mps[sample]),
                )
                for track, sample in present
            ]
            image, seen = self._stage.render(placed)
            rows = [
                _truth_row(frame, settings.fps, track, sample, vehicle, what)
                for (track, sample), vehicle, what in zip(present, placed, seen, strict=True)
                if what is not None
            ]
            yield self._codec.code(self._sensor.expose(self._lens.gather(image))), rows


def render_clip(
    settings: ClipSettings, out_dir: Path, progress: Progress | None = None
) -> ClipSummary:
    """Write video.mp4, truth.csv and camera.toml into a folder (made if missing).

    The files appear under their names only when complete. The video is MPEG-4 part 2.

    Raises:
        InputError: the folder cannot be written, or OpenCV has no MPEG-4 encoder.
    """
    out_dir = Path(out_dir)
    make_folder(out_dir)
    renderer = ClipRenderer(settings)
    camera = renderer.camera
    name = f"streetdrive-{settings.scenario}-{settings.seed}"
    return write_clip(
        out_dir,
        renderer.frames(),
        camera_toml(name, camera, renderer.road, settings.segments),
        frames=settings.frames,
        fps=settings.fps,
        size=(camera.width_px, camera.height_px),
        progress=progress,
    )
