"""Renders a SUMO view: video, ground truth and calibration in one folder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from slipstream_lab.simulation.rsus import RsuSettings, SceneSettings
from slipstream_lab.simulation.streetdrive import (
    PALETTE,
    ClipSummary,
    Progress,
    make_folder,
    write_clip,
)
from slipstream_lab.simulation.streetdrive.rendering import (
    Backdrop,
    Image,
    Light,
    Mesh,
    PlacedMesh,
    Seen,
    Sensor,
    SensorSettings,
    draw_light,
    lit,
    paint_objects,
    paint_tree_line,
    paint_tree_shadow,
    shade_sky,
    view_ground,
)
from slipstream_lab.simulation.streetdrive.vehicles import CLASS_OF_SHAPE
from slipstream_lab.simulation.sumo_view.ground import paint_roads
from slipstream_lab.simulation.sumo_view.lanes import LaneRoads
from slipstream_lab.simulation.sumo_view.pose import CameraSite, Pose, draw_pose, load_camera
from slipstream_lab.simulation.sumo_view.process import Simulation, ViewSpec
from slipstream_lab.simulation.sumo_view.roadside import (
    RoadsidePlan,
    choose_objects,
    tree_shadow_feet,
)
from slipstream_lab.simulation.sumo_view.settings import SumoClipSettings
from slipstream_lab.simulation.sumo_view.shapes import mesh_of
from slipstream_lab.simulation.sumo_view.traffic import ViewedVehicle
from slipstream_lab.simulation.sumo_view.watched_segments import (
    SegmentStretch,
    View,
    camera_text,
    choose_stretches,
)

RADIUS_M = 320.0
"""How far away vehicles are drawn."""


def _draw_light(sky: str, rng: np.random.Generator) -> Light:
    """A light of the wanted kind: many are drawn until one is."""
    while True:
        light = draw_light(rng)
        shadow = light.shadow_strength
        if sky == "any" or (shadow > 0.4 if sky == "clear" else shadow < 0.2):
            return light.exposed(float(rng.uniform(1.12, 1.25)))


def _paint_backdrop(
    view: View, roads: LaneRoads, scene: SceneSettings, rng: np.random.Generator
) -> Backdrop:
    """Everything that does not move."""
    camera, site = view.camera, view.site
    light = _draw_light(scene.sky, rng)
    plan = RoadsidePlan(roads, site)
    sky = shade_sky(camera, light, rng)
    ground_view = view_ground(camera, rng)
    ground = lit(paint_roads(ground_view, camera, roads, site, PALETTE), ground_view, light)
    if light.shadow_strength > 0.15:
        for foot in tree_shadow_feet(plan, 3, rng):
            paint_tree_shadow(ground, camera, light, rng, foot)
    picture = np.where(ground_view.hits[..., None], ground, sky)
    background: Image = np.clip(picture, 0, 255).astype(np.uint8)
    paint_tree_line(background, camera, light, rng)
    things = choose_objects(plan, roads, site, scene, rng)
    paint_objects(background, camera, light, PALETTE, rng, things)
    return Backdrop(camera, light, background)


def _axis_rad(stretches: tuple[SegmentStretch, ...], heading_rad: float) -> float:
    """Direction of the first watched road away from the camera; the camera's if it looks across.

    Buildings stand square to it.
    """
    x, y = stretches[0].direction
    for axis in (math.atan2(y, x), math.atan2(-y, -x)):
        if math.cos(axis - heading_rad) > math.cos(math.radians(50.0)):
            return axis
    return heading_rad


class SumoRenderer:
    """One clip's camera and backdrop. Raises InputError: an edge that cannot be watched."""

    def __init__(self, settings: SumoClipSettings, rsu: RsuSettings, pose: Pose, roads: LaneRoads):
        self.settings = settings
        straight = View(
            pose.camera(pose.heading_rad), CameraSite(pose.x_m, pose.y_m, pose.heading_rad)
        )
        self.stretches = choose_stretches(rsu, roads, straight, settings.rsu)
        axis = _axis_rad(self.stretches, pose.heading_rad)
        self.view = View(pose.camera(axis), CameraSite(pose.x_m, pose.y_m, axis))
        camera, scene = self.view.camera, rsu.scene
        rng = np.random.default_rng([settings.seed if scene.seed is None else scene.seed, 11])
        self._backdrop = _paint_backdrop(self.view, roads, scene, rng)
        blur, vignette, noise = rng.uniform((0.4, 0.1, 1.5), (0.7, 0.25, 3.0))
        lens = SensorSettings(
            float(blur) if scene.blur_px is None else scene.blur_px,
            float(vignette),
            float(noise) if scene.noise_levels is None else scene.noise_levels,
        )
        self._sensor = Sensor(lens, camera.width_px, camera.height_px, rng)
        self._meshes: dict[int, Mesh] = {}
        self.camera_toml = camera_text(
            f"sumo-{rsu.name}-{settings.seed}", self.stretches, self.view
        )

    def paint(
        self, scenes: Iterable[list[ViewedVehicle]]
    ) -> Iterator[tuple[Image, list[list[str]]]]:
        """Pictures (h, w, 3) BGR of the vehicles of each frame, with their truth rows in the order
        of TRUTH_COLUMNS.
        """
        for frame, vehicles in enumerate(scenes):
            placed = [self._place(vehicle) for vehicle in vehicles]
            image, seen = self._backdrop.render(placed)
            rows = [
                _truth_row(frame, self.settings.fps, vehicle, mesh, what)
                for vehicle, mesh, what in zip(
                    vehicles, (p.mesh for p in placed), seen, strict=True
                )
                if what is not None
            ]
            yield self._sensor.expose(image), rows

    def _place(self, vehicle: ViewedVehicle) -> PlacedMesh:
        number = vehicle.number
        if number not in self._meshes:
            rng = np.random.default_rng([self.settings.seed, 12, number])
            self._meshes[number] = mesh_of(vehicle.kind, rng)
        x, y = self.view.site.to_local(np.array([vehicle.x_m, vehicle.y_m]))
        turn = vehicle.heading_rad - self.view.site.axis_rad
        return PlacedMesh(self._meshes[number], float(x), float(y), 1, turn)


def _truth_row(frame: int, fps: float, vehicle: ViewedVehicle, mesh: Mesh, seen: Seen) -> list[str]:
    return [
        str(frame),
        f"{frame / fps:.6f}",
        str(vehicle.number),
        CLASS_OF_SHAPE[mesh.kind],
        f"{vehicle.x_m:.4f}",
        f"{vehicle.y_m:.4f}",
        f"{vehicle.speed_mps:.4f}",
        f"{vehicle.acceleration_mps2:.4f}",
        *(f"{value:.2f}" for value in seen.box_px),
        f"{seen.visible_fraction:.3f}",
        f"{mesh.length_m:.3f}",
        f"{mesh.width_m:.3f}",
    ]


def render_sumo_clip(
    settings: SumoClipSettings, out_dir: Path, progress: Progress | None = None
) -> ClipSummary:
    """Write video.mp4, truth.csv and camera.toml into a folder (made if missing).

    Raises:
        InputError: a file that SUMO or the RSU's settings refuse, an edge that cannot be watched,
            a vehicle that cannot be drawn, a folder that cannot be written.
        ModuleNotFoundError: libsumo is not installed.
    """
    rsu = settings.camera or load_camera(settings.rsu, settings.net, settings.rsu_id)
    out_dir = Path(out_dir)
    make_folder(out_dir)
    pose = draw_pose(rsu, settings.seed, settings.rsu)
    order = ViewSpec(
        settings.net,
        settings.routes,
        settings.additional,
        settings.seed,
        pose.x_m,
        pose.y_m,
        RADIUS_M,
        settings.start_s,
        settings.begin_s,
        settings.fps,
        settings.frames,
    )
    with Simulation(order) as simulation:
        renderer = SumoRenderer(settings, rsu, pose, simulation.roads)
        camera = renderer.view.camera
        return write_clip(
            out_dir,
            renderer.paint(simulation.frames()),
            renderer.camera_toml,
            frames=settings.frames,
            fps=settings.fps,
            size=(camera.width_px, camera.height_px),
            progress=progress,
        )
