"""One frame: detect, project to the road, track, update the window, classify each segment. No I/O
and no clock of its own: the same frames give the same states.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from edge_daemon.camera import Camera, WatchedSegment
from edge_daemon.detection import Detections, Detector
from edge_daemon.features.counts import PassageCounter
from edge_daemon.features.kinematics import SegmentKinematics, VehicleMotion, WindowFeatures
from edge_daemon.features.quarter_hours import MAX_GAP_S, QuarterHours
from edge_daemon.features.stability import StabilityJudge
from edge_daemon.features.stopped import MEMORY_S, Standing, StoppedVehicleJudge
from edge_daemon.frame import Frame
from edge_daemon.settings import StabilitySettings
from edge_daemon.tracking import Sightings, Track, Tracker
from edge_daemon.tracking.measurement import to_road_points
from edge_daemon.tracking.sightings import SightingBuffer
from slipstream.errors import InputError
from slipstream.messages import CameraFault, SegmentState, StoppedVehicle, StoppedVehicles

# As many may be of a lane beside a quiet road.
_MOST_ONCOMING = 3
_LEAD_S = 3.0  # what was seen before the window helps to smooth its beginning


@dataclass(frozen=True)
class _FrameTime:
    time_s: float
    gap_s: float


@dataclass(frozen=True)
class _Window:
    """What the states of one moment rest on."""

    sightings: Sightings | None
    begin_s: float
    observed_s: float
    coverage: float
    frames: int
    sparse: bool


class Pipeline:
    """Turns the frames of one camera into the states of its segments.

    Attributes:
        counts: of the vehicles that pass, by quarter hour.
    """

    def __init__(
        self,
        rsu: str,
        camera: Camera,
        detector: Detector,
        stability: StabilitySettings,
        window_s: float,
    ) -> None:
        self._rsu = rsu
        self._camera = camera
        self._detector = detector
        self._tracker = Tracker()
        self._judge = StabilityJudge(stability)
        self._window_s = window_s
        self._memory_s = max(window_s + _LEAD_S, MEMORY_S)
        self._sightings = SightingBuffer()
        self._frames: deque[_FrameTime] = deque()
        self._last_s: float | None = None
        self._sequence = 0
        self._states_s = 0.0
        self._kinematics = {
            segment.id: SegmentKinematics(segment, camera.pose) for segment in camera.segments
        }
        self._passed = dict.fromkeys((segment.id for segment in camera.segments), 0)
        self._windows: dict[str, WindowFeatures | None] = {}
        self._counters = {
            segment.id: PassageCounter(segment, camera.pose) for segment in camera.segments
        }
        self._fresh: dict[str, list[Sightings]] = {name: [] for name in self._counters}
        self.counts = QuarterHours(rsu, self._counters, window_s)
        self._stopped = {segment.id: StoppedVehicleJudge(segment) for segment in camera.segments}

    @property
    def tracks(self) -> tuple[Track, ...]:
        """Vehicles followed now."""
        return self._tracker.tracks

    @property
    def vehicles(self) -> dict[str, tuple[VehicleMotion, ...]]:
        """By segment, the smoothed motions that the latest states rest on."""
        return {name: window.vehicles if window else () for name, window in self._windows.items()}

    @property
    def windows(self) -> dict[str, WindowFeatures | None]:
        """By segment, what the latest states rest on; None where nothing could be measured."""
        return self._windows

    def stopped(self, state: SegmentState) -> StoppedVehicles:
        """The vehicles that stood on the segment at the latest state."""

        def told(vehicle: Standing) -> StoppedVehicle:
            since_ns, seen_ns = (
                max(0, state.time_ns - max(0, round((self._states_s - then_s) * 1e9)))
                for then_s in (vehicle.since_s, vehicle.seen_s)
            )
            return StoppedVehicle(
                lane=vehicle.lane, along_m=vehicle.along_m, since_ns=since_ns, seen_ns=seen_ns
            )

        features = state.features
        return StoppedVehicles(
            rsu=state.rsu,
            segment=state.segment,
            time_ns=state.time_ns,
            vehicles=tuple(told(vehicle) for vehicle in self._stopped[state.segment].standing),
            y_e=state.y_e,
            mean_speed_mps=None if features is None else max(0.0, features.mean_speed_mps.value),
        )

    def process(self, frame: Frame) -> Sightings:
        """Detect vehicles in a frame and `update` with them."""
        return self.update(frame, self._detector.detect(frame.image))

    def update(self, frame: Frame, detections: Detections) -> Sightings:
        """Process one frame and its detections; returns the sightings that it confirmed.

        Raises:
            InputError: the frame has another size than the calibration.
        """
        height, width = frame.image.shape[:2]
        if (width, height) != self._camera.size:
            raise InputError(
                self._camera.name,
                f"the picture is {width}×{height}, the calibration is for "
                f"{self._camera.size[0]}×{self._camera.size[1]}",
                "calibrate this camera",
                key="image",
            )
        now = frame.media_time_s
        gap_s = 0.0 if self._last_s is None else now - self._last_s
        if self._last_s is None or frame.cut or gap_s > MAX_GAP_S:
            for name, counter in self._counters.items():
                self._count(name, now)
                counter.begin(now, cut=frame.cut)
        if frame.cut:
            self._tracker.reset()
            for judge in self._stopped.values():
                judge.reset(now)
        found = to_road_points(detections, self._camera)
        sightings = self._tracker.update(now, found)
        self._sightings.add(sightings)
        if len(sightings):
            for fresh in self._fresh.values():
                fresh.append(sightings)
        self.counts.frame(now, frame.captured_ns, gap_s)
        last = self._frames[-1].time_s if self._frames else now
        self._frames.append(_FrameTime(now, now - last))
        self._last_s = now
        self._forget(now - self._window_s)
        return sightings

    def reset(self) -> None:
        """Empty the window and drop all tracks: data so far is not to be trusted."""
        self._tracker.reset()
        self._judge.reset()
        for judge in self._stopped.values():
            judge.reset()
        for name, counter in self._counters.items():
            counter.reset()
            self._fresh[name].clear()
        self.counts.take_back()
        self._sightings = SightingBuffer()
        self._frames.clear()

    def finish_counts(self) -> None:
        """No frame comes any more: count the vehicles that have just passed, too."""
        if self._last_s is None:
            return
        for name, counter in self._counters.items():
            self._count(name, self._last_s)
            counter.finish()
            measured = self._windows.get(name)
            passed = counter.take(math.inf, measured.vehicles if measured else ())
            self.counts.add(name, passed, counter.lost())
        self.counts.finish()

    def _count(self, segment: str, now_s: float) -> None:
        """Give what was seen since the last call to a segment's counter."""
        fresh = self._fresh[segment]
        self._counters[segment].update(now_s, Sightings.join(fresh) if fresh else None)
        fresh.clear()

    def _forget(self, before_s: float) -> None:
        self._sightings.drop(before_s + self._window_s - self._memory_s)
        while self._frames and self._frames[0].time_s < before_s:
            self._frames.popleft()

    def states(
        self, time_ns: int, idle_s: float = 0.0, fault: CameraFault | None = None
    ) -> list[SegmentState]:
        """The state of each segment over the window that ends now; arguments of `iter_states`."""
        return list(self.iter_states(time_ns, idle_s, fault))

    def iter_states(
        self, time_ns: int, idle_s: float = 0.0, fault: CameraFault | None = None
    ) -> Iterator[SegmentState]:
        """The same states, each computed when it is requested, all over the window that ends at
        this call, whatever frames are taken in between.

        Args:
            time_ns: UTC of the last frame, or of now if none has come.
            idle_s: time since the last frame: that much of the window is empty.
            fault: why the camera cannot be trusted now; all segments are unknown for it.
        """
        now_s = 0.0 if self._last_s is None else self._last_s + idle_s
        self.counts.tick(now_s, time_ns, fault)
        # Time goes on when all frames have left the window.
        begin_s = 0.0 if self._last_s is None else self._last_s + idle_s - self._window_s
        if idle_s > 0:
            self._forget(begin_s)
        # A frame stands for the time since the one before it, unless the source paused.
        observed_s = sum(f.gap_s for f in self._frames if f.gap_s <= MAX_GAP_S)
        window = _Window(
            self._sightings.all(),
            begin_s,
            observed_s,
            coverage=min(1.0, observed_s / self._window_s),
            frames=len(self._frames),
            sparse=sum(f.gap_s > MAX_GAP_S for f in self._frames) > len(self._frames) / 2,
        )
        return (self._state(each, window, time_ns, fault) for each in self._camera.segments)

    def _state(
        self,
        segment: WatchedSegment,
        window: _Window,
        time_ns: int,
        fault: CameraFault | None,
    ) -> SegmentState:
        measured, oncoming, wrong_way = None, 0, 0
        if fault is None and window.sightings is not None and window.observed_s > 0:
            kinematics = self._kinematics[segment.id]
            measured = kinematics.features(window.sightings, window.begin_s, window.observed_s)
            oncoming, wrong_way = kinematics.oncoming, kinematics.wrong_way
        self._states_s = window.begin_s + self._window_s
        self._stopped[segment.id].update(self._states_s, window.sightings)
        features = measured.features if measured else None
        self._windows[segment.id] = measured
        counter = self._counters[segment.id]
        self._count(segment.id, self._states_s)
        passed = counter.take(self._states_s, measured.vehicles if measured else ())
        self._passed[segment.id] += len(passed)
        self.counts.add(segment.id, passed, counter.lost())
        if measured is not None:
            self.counts.look(segment.id, measured.occluded_share)
        vehicles = len(measured.vehicles) if measured else 0
        flag = (
            self._judge.judge(
                segment.id,
                time_ns,
                features,
                vehicles,
                window.frames,
                window.coverage,
                variance=measured.variance if measured else None,
                sparse=window.sparse,
            )
            if fault is None
            else self._judge.invalidate(segment.id, fault)
        )
        if flag.reason == "too_few_vehicles" and oncoming > vehicles + _MOST_ONCOMING:
            flag = self._judge.invalidate(segment.id, "opposite_direction")
            self._passed[segment.id] = 0
        elif wrong_way and self._passed[segment.id] > _MOST_ONCOMING:
            flag = self._judge.invalidate(segment.id, "wrong_way")
        self._sequence += 1
        return SegmentState(
            rsu=self._rsu,
            segment=segment.id,
            sequence=self._sequence,
            time_ns=time_ns,
            window_s=self._window_s,
            features=features,
            y_e=flag.y_e,
            reason=flag.reason,
            vehicles=vehicles,
            frames=window.frames,
            coverage=window.coverage,
            p_stable=flag.p_stable,
        )
