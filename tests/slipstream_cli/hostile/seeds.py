"""The files that commands of `slipstream` read: a valid one of each kind, and how it is read."""

from __future__ import annotations

import gzip
import json
import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomli_w

import storage
from slipstream.messages import Estimate, KinematicFeatures, SegmentState
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.instance import write_instance

REPOSITORY = Path(__file__).parents[3]
DEPLOY = REPOSITORY / "deploy" / "config"
WIDTH, HEIGHT = 320, 180


@dataclass(frozen=True)
class Kind:
    """One kind of file.

    Attributes:
        name: of the kind.
        files: valid files.
        command: that reads it; FILE stands for it, DIR for the folder of valid files.
        share: of all hostile files, relative to the other kinds.
        text: whether the file is one for people to write.
        may_fail: it may be a fault of the file that is no user's mistake: exit status 1.
    """

    name: str
    files: Sequence[Path]
    command: str
    share: float = 1.0
    text: bool = True
    may_fail: bool = False

    def arguments(self, file: Path, folder: Path) -> list[str]:
        """The command line for one file."""
        words = self.command.split()
        return [word.replace("FILE", str(file)).replace("DIR", str(folder)) for word in words]


def make_kinds(folder: Path) -> list[Kind]:
    """Write a valid file of each kind into a folder."""
    points = _points()
    camera = {
        "schema": 1,
        "name": "c",
        "image": {"width": WIDTH, "height": HEIGHT},
        "points": points,
        "segments": [
            {
                "id": "avenue_east",
                "polygon": [[25.0, -4.0], [70.0, -4.0], [70.0, 4.0], [25.0, 4.0]],
                "direction": [-1.0, 0.0],
                "lanes": 2,
                "lane_width_m": 3.5,
            }
        ],
    }
    (folder / "camera.toml").write_text(tomli_w.dumps(camera))
    lines = [",".join(map(str, (*p["image"], *p["road"]))) for p in points]
    (folder / "points.csv").write_text("u,v,x,y\n" + "\n".join(lines) + "\n")
    _write_pictures(folder)
    demo_fleet = REPOSITORY / "dispatcher_daemon" / "data" / "demo_fleet.toml"
    shutil.copy(demo_fleet, folder / "fleet.toml")
    net = REPOSITORY / "slipstream" / "data" / "demo.net.xml"
    shutil.copy(net, folder / "net.net.xml")
    (folder / "net.net.xml.gz").write_bytes(gzip.compress(net.read_bytes(), mtime=0))
    instance = open_instance("arc25-01-avenue")
    write_instance(instance, folder / "instance.json")
    write_instance(instance, folder / "instance.toml")
    _write_settings(folder)
    storage.open_database(f"sqlite:///{folder / 'slipstream.db'}").close()
    (folder / "truth.csv").write_text(
        "frame,time_s,vehicle_id,x_m,y_m,speed_mps,acceleration_mps2,x1_px,y1_px,x2_px,y2_px,"
        "visible_fraction,length_m\n"
        + "".join(
            f"{i},{i / 30:.3f},1,{50 - i},1.7,15.0,0.1,10,10,20,20,1.0,4.5\n" for i in range(30)
        )
    )
    (folder / "states.jsonl").write_text("".join(_state(i) for i in range(8)))
    (folder / "routes.rou.xml").write_text(_ROUTES)
    weights = REPOSITORY / "edge_daemon" / "weights" / "yolo11n-streetdrive.xml"
    scenarios = REPOSITORY / "simulation" / "scenarios" / "data"
    town = scenarios / "corridor" / "corridor.net.xml.gz"
    world = f"evaluate --out out --stored --scenario mine --net {town} --begin 0 --hours 1"
    calibrate = "calibrate --out out.toml --overlay grid.png"
    return [
        Kind("edge", [folder / "edge.toml", folder / "edge-full.toml"], "check --as site FILE", 3),
        Kind("server", [DEPLOY / "site-server.toml"], "check --as site FILE", 5),
        Kind("guessed", [folder / "fleet.toml", DEPLOY / "site-server.toml"], "check FILE"),
        Kind(
            "camera", [folder / "camera.toml"], "track none.mp4 --camera FILE --truth none.csv", 3
        ),
        Kind(
            "points",
            [folder / "camera.toml", folder / "points.csv"],
            f"{calibrate} --image DIR/picture.png --points FILE",
            3,
        ),
        Kind(
            "picture",
            [folder / "picture.png", folder / "picture.jpg", folder / "picture.bmp"],
            f"{calibrate} --image FILE --points DIR/camera.toml",
            3,
            text=False,
        ),
        Kind(
            "video",
            [folder / "video.mp4", folder / "video.avi"],
            f"{calibrate} --image FILE --points DIR/camera.toml",
            2,
            text=False,
        ),
        Kind(
            "tracked video",
            [folder / "video.mp4"],
            "track FILE --camera DIR/camera.toml --out states.jsonl --threads 1",
            0.3,
            text=False,
        ),
        Kind("fleet", [folder / "fleet.toml"], "check --as fleet FILE", 3),
        Kind("fleet (JSON)", [folder / "fleet.json"], "check --as fleet FILE", 2),
        Kind(
            "instance",
            [folder / "instance.json", folder / "instance.toml"],
            "check --as instance FILE",
            3,
        ),
        Kind(
            "solved instance",
            [folder / "instance.json"],
            "solve --instance FILE --write model.json",
            1,
        ),
        Kind("verified instance", [folder / "instance.json"], "verify --options 1 FILE", 0.5),
        Kind(
            "net",
            [folder / "net.net.xml"],
            "check --as fleet DIR/fleet.toml --network FILE",
            4,
        ),
        Kind(
            "net (packed)",
            [folder / "net.net.xml.gz"],
            "check --as fleet DIR/fleet.toml --network FILE",
            1,
            text=False,
        ),
        Kind(
            "net of a world",
            [town],
            world.replace(str(town), "FILE"),
            0.15,
            text=False,
        ),
        Kind("demand", [scenarios / "corridor" / "demand.toml"], f"{world} --demand FILE", 0.15),
        Kind("RSUs", [scenarios / "corridor" / "rsus.toml"], f"{world} --rsus FILE", 0.15),
        Kind("deliveries", [scenarios / "corridor" / "fleet.toml"], f"{world} --fleet FILE", 0.15),
        Kind(
            "routes",
            [folder / "routes.rou.xml"],
            f"{world} --rsus {scenarios / 'corridor' / 'rsus.toml'} --routes FILE",
            0.15,
        ),
        Kind("model", [weights], "check --as site DIR/edge-model.toml", 1),
        Kind("states", [folder / "states.jsonl"], "robustness FILE --draws 1", 2),
        Kind(
            "truth",
            [folder / "truth.csv"],
            "track none.mp4 --camera DIR/camera.toml --truth FILE",
            2,
        ),
        Kind(
            "database",
            [folder / "slipstream.db"],
            "db check --url sqlite:///FILE",
            1,
            text=False,
            may_fail=True,
        ),
        Kind(
            "upgraded database",
            [folder / "slipstream.db"],
            "db upgrade --url sqlite:///FILE",
            0.5,
            text=False,
            may_fail=True,
        ),
        Kind(
            "pruned database",
            [folder / "slipstream.db"],
            "db prune --keep-days 1 --url sqlite:///FILE",
            0.5,
            text=False,
            may_fail=True,
        ),
    ]


def _points() -> list[dict[str, list[float]]]:
    """Points of a camera 9 m above a flat road that looks along it."""
    return [
        {
            "image": [round(WIDTH / 2 - 250 * y / x, 2), round(40 + 250 * 9 / x, 2)],
            "road": [float(x), float(y)],
        }
        for x in (18, 30, 45, 80)
        for y in (-7, 7)
    ]


def _write_pictures(folder: Path) -> None:
    rng = np.random.default_rng(1)
    picture = rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    for name in ("picture.png", "picture.jpg", "picture.bmp"):
        assert cv2.imwrite(str(folder / name), picture)
    for name, codec in (("video.mp4", "mp4v"), ("video.avi", "MJPG")):
        writer = cv2.VideoWriter(
            str(folder / name), cv2.VideoWriter.fourcc(*codec), 10, (WIDTH, HEIGHT)
        )
        for _ in range(5):
            writer.write(picture)
        writer.release()


def _write_settings(folder: Path) -> None:
    edge = {
        "camera": str(folder / "missing.toml"),
        "source": {"clip": str(folder / "video.mp4"), "loop": True},
    }
    full = {
        **edge,
        "window_s": 10.0,
        "state_interval_s": 1.0,
        "detector": {"threads": 2},
        "stability": {"max_speed_cv": 0.12, "min_vehicles": 3, "hysteresis": 0.05},
        "watch": {"max_shift_share": 0.003},
        "preview": {"fps": 2.0},
        "metrics_port": 9464,
    }
    shared = {"bus": {"connect": ["tcp/127.0.0.1:7447"]}, "service": {"log_level": "INFO"}}
    # What stands beside it as `model` is looked at.
    model = {**edge, "camera": str(folder / "camera.toml"), "detector": {"model": "hostile"}}
    for name, settings in (("edge", edge), ("edge-full", full), ("edge-model", model)):
        (folder / f"{name}.toml").write_text(tomli_w.dumps({**shared, "rsus": {"r": settings}}))
    fleet = tomllib.loads((folder / "fleet.toml").read_text())
    (folder / "fleet.json").write_text(json.dumps(fleet, indent=1))


def _state(number: int) -> str:
    def estimate(value: float) -> Estimate:
        return Estimate(value=value, standard_error=0.1)

    features = KinematicFeatures(
        mean_speed_mps=estimate(15.0),
        mean_acceleration_mps2=estimate(0.1),
        density_veh_per_m=estimate(0.04),
        speed_std_mps=estimate(0.5 + number),
        acceleration_variance_m2ps4=estimate(0.1),
        mean_gap_m=estimate(20.0),
    )
    return (
        SegmentState(
            rsu="r",
            segment="avenue_east",
            sequence=number,
            time_ns=number * 10**9,
            window_s=10.0,
            features=features,
            y_e=1 if number < 4 else 0,
            reason=None,
            vehicles=5,
            frames=300,
            coverage=1.0,
        ).model_dump_json()
        + "\n"
    )


_ROUTES = """<routes>
    <vType id="car" accel="2.6"/>
    <route id="r0" edges="e0_main"/>
    <vehicle id="v0" type="car" route="r0" depart="0.0"/>
    <trip id="t0" from="e0_main" to="e0_main" depart="1.0"/>
</routes>
"""
