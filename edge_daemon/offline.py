"""One recorded video through the whole pipeline: states out, with how long each frame took."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Self

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Camera
from edge_daemon.detection import detect_stream, open_detector, prefetch
from edge_daemon.features import VehicleMotion
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.preview import annotate, draw_time
from edge_daemon.settings import TrackSettings
from edge_daemon.sources import hidden, mark_repeats
from edge_daemon.sources.clip import FastClip, open_clip
from edge_daemon.sources.rate import Rate
from edge_daemon.tracking import HIGH_SCORE, Sightings
from edge_daemon.watch import Watch, read_reference
from slipstream.errors import InputError
from slipstream.messages import CameraFault, SegmentCounts, SegmentState
from slipstream.service import rss_mb

log = logging.getLogger(__name__)

_PREFETCHED_FRAMES: Final = 3
_SPEED_LAG_S: Final = 1.0


@dataclass
class Recorder:
    """Records sightings, speeds and states of a run, for scoring."""

    frame_times_s: list[float] = field(default_factory=list)
    sightings: list[Sightings] = field(default_factory=list)
    states: list[tuple[float, SegmentState]] = field(default_factory=list)
    speeds: list[tuple[int, float, float, float]] = field(default_factory=list)

    def frame(self, time_s: float, sightings: Sightings) -> None:
        """Note one frame, by its media time, and the sightings that it confirmed."""
        self.frame_times_s.append(time_s)
        self.sightings.append(sightings)

    def tick(
        self,
        time_s: float,
        every_s: float,
        states: Sequence[SegmentState],
        vehicles: dict[str, tuple[VehicleMotion, ...]],
    ) -> None:
        """Record the states at a media time, and each speed once, a second after its time."""
        self.states.extend((time_s, state) for state in states)
        begin, end = time_s - _SPEED_LAG_S - every_s, time_s - _SPEED_LAG_S
        for vehicle in (v for of_segment in vehicles.values() for v in of_segment):
            motion = vehicle.motion
            deviation = vehicle.speed_std_mps
            for i in np.flatnonzero((motion.time_s >= begin) & (motion.time_s < end)):
                if vehicle.weight_s[i] > 0:
                    self.speeds.append(
                        (
                            vehicle.track,
                            float(motion.time_s[i]),
                            float(motion.speed_mps[i]),
                            float(deviation[i]),
                        )
                    )


@dataclass
class TrackResult:
    """What came of a video.

    Attributes:
        states: all in order; their times are media times since the clip's beginning.
        recorder: what scores are made from; frames under a fault of the camera are left out.
        done_s: monotonic time at which each frame had gone through.
        latency_s: of each frame, from decoded to processed.
        gap_s: time that the video's time stamps leave out between its frames.
        decode_errors: frames that could not be read.
        repeated: frames that repeated the one before, which nothing was measured in.
        fault_s: for how long each fault of the frame was reported: it begins after its wait and
            ends some seconds after its last sign.
        counts: of each quarter hour since the clip's beginning and each segment; the last quarter
            hour is as long as the clip lets it be.
    """

    rate: Rate
    states: list[SegmentState] = field(default_factory=list)
    recorder: Recorder = field(default_factory=Recorder)
    done_s: list[float] = field(default_factory=list)
    latency_s: list[float] = field(default_factory=list)
    gap_s: float = 0.0
    decode_errors: int = 0
    repeated: int = 0
    fault_s: dict[CameraFault, float] = field(default_factory=dict)
    counts: list[SegmentCounts] = field(default_factory=list)
    rss_mb: float = 0.0


def track(
    video: Path,
    camera: Camera,
    settings: TrackSettings,
    *,
    fps: float | None = None,
    annotated: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> TrackResult:
    """Follow a video from its first to its last frame, as fast as it goes; no frame is left out.

    Args:
        fps: frames a second that it was filmed at; None: as it says.
        annotated: where to write the video with what was seen drawn over it.
        progress: called with the numbers of processed and of expected frames.

    Raises:
        InputError: the video, the model, the reference frame or the target cannot be used, the
            frames are not of the calibrated size, or nothing says their rate.
    """
    watch = Watch(camera, settings.watch, read_reference(camera))
    reader = open_clip(video, loop=False, size=camera.size, fps=fps)
    detector = open_detector(settings.detector, camera)
    pipeline = Pipeline("offline", camera, detector, settings.stability, settings.window_s)
    result = TrackResult(reader.rate)
    due_s = last_s = left_out_s = 0.0
    fault: CameraFault | None = None
    boxes: npt.NDArray[np.float32] | None = None
    all_boxes: npt.NDArray[np.float32] | None = None
    latest: dict[str, SegmentState] = {}
    source = FastClip(reader)
    read = hidden(prefetch(source.frames(), _PREFETCHED_FRAMES), camera.masks)
    frames = detect_stream(mark_repeats(read), detector)
    with closing(frames), _AnnotatedVideo(annotated, reader.fps, camera) as annotated_video:
        for frame, detections in frames:
            if frame is None:
                continue
            left_out_s += frame.left_out_s
            now = frame.media_time_s + left_out_s
            result.repeated += frame.repeated
            # A recording's own time: this machine's clocks say when it was read, not taken.
            seen = replace(frame, media_time_s=now, captured_s=now, captured_ns=round(now * 1e9))
            if detections is not None:
                boxes = detections.boxes_above(HIGH_SCORE)
                all_boxes = detections.boxes
            before, fault = fault, watch.look(seen, boxes, all_boxes)
            if fault is None and detections is not None:
                result.recorder.frame(now, pipeline.update(seen, watch.steady(detections)))
            elif fault is not None:
                result.fault_s[fault] = result.fault_s.get(fault, 0.0) + (
                    frame.media_time_s - last_s
                )
                if fault != before:
                    pipeline.reset()
                    log.warning(
                        "%s: the camera has a fault after %.1f s: %s",
                        video,
                        now,
                        f"{fault}: {watch.detail}" if watch.detail else fault,
                    )
            last_s = frame.media_time_s
            if now >= due_s:
                states = pipeline.states(round(now * 1e9), fault=fault)
                result.recorder.tick(now, settings.state_interval_s, states, pipeline.vehicles)
                result.states += states
                latest |= {state.segment: state for state in states}
                # One state after a gap, not one for each that would have been due in it.
                due_s += settings.state_interval_s * (
                    1 + int((now - due_s) / settings.state_interval_s)
                )
            result.done_s.append(time.monotonic())
            result.latency_s.append(result.done_s[-1] - frame.captured_s)
            annotated_video.add(seen, pipeline, latest, frame.media_time_s)
            if progress is not None:
                progress(len(result.done_s), reader.expected_frames)
    pipeline.finish_counts()
    for segment in camera.segments:
        result.counts += pipeline.counts.complete(segment.id)
        running = pipeline.counts.running(segment.id)
        result.counts += [] if running is None else [running]
    result.gap_s = source.counters.gap_s
    result.decode_errors = source.counters.decode_errors
    result.rss_mb = rss_mb()
    return result


class _AnnotatedVideo:
    """The annotated video, if one is wanted; under its name only when complete. Its frames are
    evenly spaced: those of the clip are repeated or left out so that it plays at the clip's own
    speed.
    """

    def __init__(self, path: Path | None, fps: float, camera: Camera) -> None:
        self._path = path
        self._camera = camera
        self._fps = fps
        self._written = 0
        self._writer: cv2.VideoWriter | None = None
        if path is None:
            return
        self._part = path.with_name(f"{path.stem}.part{path.suffix or '.mp4'}")
        self._writer = cv2.VideoWriter(
            str(self._part), cv2.VideoWriter.fourcc(*"mp4v"), fps, camera.size
        )
        if not self._writer.isOpened():
            raise InputError(
                path, "no video can be written here", "give a .mp4 in a folder of yours"
            )

    def add(
        self, frame: Frame, pipeline: Pipeline, states: dict[str, SegmentState], at_s: float
    ) -> None:
        """Draw one frame, shown at a media time."""
        if self._writer is None:
            return
        due = round(at_s * self._fps) + 1
        if due <= self._written:
            return
        picture = annotate(
            frame.image,
            self._camera,
            pipeline.tracks,
            states,
            frame.media_time_s,
            self._camera.size[0],
            _clip_time,
        )
        draw_time(picture, _clip_time(frame.captured_ns))
        for _ in range(due - self._written):
            self._writer.write(picture)
        self._written = due

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self._writer is not None and self._path is not None:
            self._writer.release()
            if kind is None:
                self._part.replace(self._path)
            else:
                self._part.unlink(missing_ok=True)


def _clip_time(time_ns: int) -> str:
    return f"{time_ns / 1e9:.1f} s"


def frame_times_ms(result: TrackResult) -> tuple[float, float, float, float]:
    """Median and 95th percentile of the time a frame takes, and of its latency, ms. The former is
    that between frames leaving the pipeline, ticks at which states are made included: stages
    overlap, so it is shorter than the latency.
    """
    steps = 1e3 * np.diff(result.done_s) if len(result.done_s) > 1 else np.zeros(1)
    latency = 1e3 * np.array(result.latency_s) if result.latency_s else np.zeros(1)
    return (
        float(np.median(steps)),
        float(np.percentile(steps, 95)),
        float(np.median(latency)),
        float(np.percentile(latency, 95)),
    )
