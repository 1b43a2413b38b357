"""What the calibration page asks: a fit while points move, traffic, a guess, a save. No HTTP."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from edge_daemon.calibration.calibration import Calibration, calibrate
from edge_daemon.calibration.files import read_points
from edge_daemon.calibration.guess import guess
from edge_daemon.calibration.lines import drawn
from edge_daemon.calibration.presets import LANE_MARKS
from edge_daemon.calibration.recording import Recording
from edge_daemon.calibration.saving import check_size, save
from edge_daemon.calibration.snapping import snap
from edge_daemon.calibration.traffic import detect, follow
from edge_daemon.camera import Camera
from edge_daemon.camera.checks import check_lines
from edge_daemon.camera.curved import CurvedRoad
from edge_daemon.camera.fit import Observations, fit_road
from edge_daemon.camera.homography import CalibrationError
from edge_daemon.detection import Detections
from edge_daemon.frame import Image
from edge_daemon.settings import PointsSettings
from slipstream.config import check
from slipstream.errors import InputError

log = logging.getLogger(__name__)

_MIN_POINTS: Final = 4
_STALE: Final = "calibrate first: the points have changed"

Answer = dict[str, Any]


class Session:
    """One camera that is being calibrated. Methods may be called from several threads.

    Args:
        picture_file: the picture that was given; None where it is a clip or a camera.
        out: the camera.toml to write.
        model: detector for traffic and guess, as `detector.model`.
        start: points to begin with.
        name: the camera's.

    Raises:
        InputError: the points are for another picture; the file at ``out`` is no camera.toml.
    """

    def __init__(
        self,
        recording: Recording,
        picture_file: Path | None,
        out: Path,
        model: str,
        start: PointsSettings | None,
        name: str | None,
    ) -> None:
        self._recording = recording
        self._picture_file = picture_file
        self._out = out
        self._model = model
        self._start = start.model_dump(mode="json") if start else {}
        if start is not None:
            check_size(start, self.size, Path("points"), picture_file)
        if not self._start.get("segments") and out.exists():
            self._start["segments"] = read_points(out).model_dump(mode="json")["segments"]
        self._name = name
        self._last: Calibration | None = None
        self._number = 0  # of the last fit: an answer is for what was asked with it
        self._detections: list[Detections] | None = None
        self._detecting: threading.Thread | None = None
        self._progress, self._failed = 0.0, ""
        self._lock = threading.Lock()

    @property
    def picture(self) -> Image:
        """What is clicked in."""
        return self._recording.picture

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture, px."""
        return self.picture.shape[1], self.picture.shape[0]

    def begin(self) -> Answer:
        """What the page has to know first."""
        start = self._start
        return {
            "size": self.size,
            "presets": [asdict(marks) for marks in LANE_MARKS],
            "points": start.get("points", []),
            "lines": start.get("lines", []),
            "segments": start.get("segments", []),
            "terms": start.get("terms"),
            "moving": len(self._recording.times_s) > 1,
            "out": str(self._out),
        }

    def snap(self, question: Answer) -> Answer:
        """The corner near a click."""
        u, v = snap(self.picture, float(question["u"]), float(question["v"]))
        return {"image": [round(u, 2), round(v, 2)]}

    def fit(self, question: Answer) -> Answer:
        """Fit the points as they are now. While something is dragged (`live`), terms and
        contradictions are those found last, and the accuracy is left out.
        """
        last = self._known(question) if question.get("live") else None
        if last is not None and len(last.used) == len(question.get("points", [])):
            return self._quick(self._given(question), last)
        with self._lock:
            self._last = None
            self._number += 1
            number = self._number
        few = _MIN_POINTS - len(question.get("points", []))
        if few > 0:
            return {"problem": f"{few} more point{'s' if few > 1 else ''} needed: four at least"}
        given = self._given(question)
        calibration = calibrate(
            given.points, given.segments, self.size, Path("points"), given.lines, given.terms
        )
        with self._lock:
            if number == self._number:
                self._last = calibration
        pose = calibration.pose
        return {
            **drawn(calibration.projection, given, calibration.used, self.size),
            "fit": number,
            "terms": calibration.terms,
            "rms_px": calibration.reprojection_error_px,
            "pose": pose and {"height_m": pose.height_m, "focal_px": pose.focal_px},
            "ends": [end.as_json() for end in calibration.accuracy],
            "warnings": calibration.warnings,
        }

    def measure(self, question: Answer) -> Answer:
        """The distance on the road between two places of the picture."""
        last = self._known(question)
        if last is None:
            return {"problem": _STALE}
        projection = last.projection
        ends = projection.to_road(question["ends"])
        if not np.isfinite(ends).all():
            return {"problem": "an end lies above the horizon"}
        # Stations along a bend are no lengths across it.
        places = projection.surface(ends) if isinstance(projection, CurvedRoad) else ends
        metres = float(np.linalg.norm(places[1] - places[0]))
        return {"metres": metres, "road": ends.round(2).tolist()}

    def traffic(self, question: Answer) -> Answer:
        """Speeds of the vehicles of the recording; the boxes are found once."""
        found = self._found()
        if isinstance(found, dict):
            return found
        last = self._known(question)
        if last is None:
            return {"problem": _STALE}
        camera = Camera(
            "page", self.size, last.road_m[last.used], last.image_px[last.used], (),
            projection=last.projection,
        )  # fmt: skip
        stations = last.road_m[last.used, 0]
        reach = float(stations.min()), float(stations.max())
        vehicles = follow(self._recording, found, camera, reach)
        return {
            "vehicles": [
                {
                    "kind": vehicle.kind,
                    "kmh": vehicle.speed_kmh,
                    "metres": vehicle.metres,
                    "path": vehicle.path_px[:: max(1, len(vehicle.path_px) // 30)].tolist(),
                }
                for vehicle in vehicles
            ]
        }

    def guess(self, question: Answer) -> Answer:
        """A first guess from the traffic."""
        found = self._found()
        if isinstance(found, dict):
            return found
        guessed = guess(found, self.size)
        if guessed is None:
            return {"problem": "too few cars drive through the picture for a guess"}
        return {
            "points": [point.model_dump(mode="json") for point in guessed.points],
            "relative_error": guessed.relative_error,
            "vehicles": guessed.vehicles,
        }

    def save(self, question: Answer) -> Answer:
        """Write the camera.toml, by the way of the command line."""
        given = self._given(question)
        calibration = save(
            given,
            Path("points"),
            self.picture,
            self._picture_file,
            self._out,
            name=self._name,
            keeps_segments=False,
        )
        without = "" if calibration.segments else "; it has no segments yet"
        return {"saved": f"{self._out} written{without}", "warnings": calibration.warnings}

    def answers(self) -> dict[str, Callable[[Answer], Answer]]:
        """What can be asked, by name."""
        return {
            "snap": self.snap,
            "fit": self.fit,
            "measure": self.measure,
            "traffic": self.traffic,
            "guess": self.guess,
            "save": self.save,
        }

    def _known(self, question: Answer) -> Calibration | None:
        """The last fit, if the question is about it."""
        with self._lock:
            return self._last if question.get("fit") == self._number else None

    def _given(self, question: Answer) -> PointsSettings:
        keys = ("points", "lines", "segments")
        data: Answer = {key: question.get(key, []) for key in keys}
        data["masks"] = self._start.get("masks", [])
        if question.get("terms") is not None:
            data["terms"] = question["terms"]
        if self._start.get("name") is not None:
            data["name"] = self._start["name"]
        return check(data, PointsSettings, "points")

    def _quick(self, given: PointsSettings, last: Calibration) -> Answer:
        road = np.array([point.road for point in given.points])
        image = np.array([point.image for point in given.points])
        lines = check_lines(given.lines, self.size, Path("points"))
        known = Observations(road, image, lines).only(last.used)
        try:
            projection = fit_road(known, self.size, last.terms, last.projection)
        except CalibrationError as error:
            raise InputError("points", error.problem, error.mend) from None
        misses = projection.residuals_px(known.road_m, known.image_px)
        return {
            **drawn(projection, given, last.used, self.size),
            "terms": last.terms,
            "rms_px": float(np.sqrt(np.mean(misses**2))),
            "live": True,
        }

    def _found(self) -> list[Detections] | Answer:
        """The boxes, or how far their finding is."""
        if len(self._recording.times_s) < 2:
            return {"problem": "a single picture has no traffic: give a clip or a camera"}
        with self._lock:
            if self._detections is not None:
                return self._detections
            if self._failed:
                failed, self._failed = self._failed, ""
                return {"problem": failed}
            if self._detecting is None or not self._detecting.is_alive():
                self._progress = 0.0
                self._detecting = threading.Thread(target=self._detect, daemon=True)
                self._detecting.start()
        return {"progress": self._progress}

    def _detect(self) -> None:
        def progress(share: float) -> None:
            self._progress = share

        try:
            self._detections = detect(self._recording, self._model, progress)
        except InputError as error:
            self._failed = str(error)
        except Exception as fault:
            log.exception("the traffic could not be looked for")
            self._failed = f"the detector failed: {str(fault) or type(fault).__name__}"
