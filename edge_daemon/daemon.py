"""The pipeline as a service: frames in, states and health on the bus once a second."""

from __future__ import annotations

import gc
import logging
import math
import time
from collections import deque
from collections.abc import Iterator
from contextlib import closing
from functools import partial

import numpy as np
import numpy.typing as npt

from edge_daemon import metrics
from edge_daemon.calibration.calibration import stated_calibration
from edge_daemon.camera import Camera, load_camera
from edge_daemon.detection import Detections, Detector, detect_stream, open_detector
from edge_daemon.frame import Frame
from edge_daemon.pipeline import Pipeline
from edge_daemon.publishing import CountsPublisher, Previews, StoppedPublisher, warn_of_direction
from edge_daemon.runtime import StageTimer
from edge_daemon.settings import EdgeSettings
from edge_daemon.sources import FrameSource, hidden, mark_repeats, open_source
from edge_daemon.tracking import HIGH_SCORE
from edge_daemon.watch import STALE_AFTER_S, Watch, read_reference
from slipstream.bus import Bus
from slipstream.messages import (
    CAMERA_FAULTS,
    CameraCalibration,
    CameraFault,
    RsuHealth,
    SegmentState,
    StabilityLimits,
    rsu_health_key,
    state_key,
)
from slipstream.service import LogLimiter, Service, configure_logging, rss_mb
from slipstream.service.memory import configure_allocator
from slipstream.service.tracing import span

log = logging.getLogger(__name__)

_RECENT_S = 10.0
_MANY_REPEATS = 0.1
_RECONNECT_S = 30.0


def run_edge(settings: EdgeSettings) -> None:
    """Run until stopped, or until a clip that does not loop has ended."""
    configure_allocator()
    configure_logging(f"edge {settings.rsu}", settings.service)
    camera = load_camera(settings.camera)
    calibration = stated_calibration(settings.camera, camera)
    reference = read_reference(camera)
    watch = Watch(camera, settings.watch, reference)
    detector = open_detector(settings.detector, camera)
    pipeline = Pipeline(
        settings.rsu,
        camera,
        detector,
        settings.stability,
        settings.window_s,
    )
    with Service("edge", settings.service) as service:
        bus = service.start("bus", partial(Bus.open, settings.bus), Bus.fault)
        log.info("the calibration fits its points to %.2f px", camera.reprojection_error_px)
        if reference is None:
            log.info("no reference picture: the first seconds are taken for the calibrated view")
        source = service.start("source", lambda: closing(open_source(settings.source, camera.size)))
        EdgeDaemon(
            settings, camera, detector, pipeline, watch, source, bus, service, calibration
        ).run()


class EdgeDaemon:
    """Passes frames through the pipeline and publishes states, health and previews."""

    def __init__(
        self,
        settings: EdgeSettings,
        camera: Camera,
        detector: Detector,
        pipeline: Pipeline,
        watch: Watch,
        source: FrameSource,
        bus: Bus,
        service: Service,
        calibration: CameraCalibration | None = None,
    ) -> None:
        self._settings = settings
        self._camera = camera
        self._calibration = calibration
        self._detector = detector
        self._pipeline = pipeline
        self._watch = watch
        self._source = source
        self._service = service
        self._state_publishers = {
            segment.id: bus.publisher(state_key(settings.rsu, segment.id), history=0)
            for segment in camera.segments
        }
        self._standing = StoppedPublisher(settings.rsu, camera, bus)
        # A clip that is read as fast as it goes has no quarter hours.
        self._counting = (
            None if settings.source.pace == "fast" else CountsPublisher(settings.rsu, camera, bus)
        )
        self._health_publisher = bus.publisher(rsu_health_key(settings.rsu), history=0)
        self._previews = Previews(settings, camera, bus)
        self._started_ns = time.time_ns()
        self._frames = 0
        self._published_ns, self._published_frames = self._started_ns, 0
        self._repeated = 0
        self._boxes: npt.NDArray[np.float32] | None = None
        self._all_boxes: npt.NDArray[np.float32] | None = None
        self._states = 0
        self._recent: deque[tuple[float, float]] = deque()
        self._latest: dict[str, SegmentState] = {}
        self._last_frame: Frame | None = None
        self._fault: CameraFault | None = None
        self._fault_began_s = 0.0
        self._limiter = LogLimiter()
        self._stages = StageTimer()
        self._skipped = 0

    def run(self) -> None:
        """Process frames until the service stops or the source ends."""
        self._service.ready()
        for reason in CAMERA_FAULTS:
            metrics.FAULT.labels(reason).set(0)
        # Loaded modules stay: to scan them in each collection takes 30 ms.
        gc.collect()
        gc.freeze()
        due_s = preview_due_s = -math.inf
        publishing: Iterator[None] = iter(())
        stages = self._stages
        frames = mark_repeats(hidden(self._source.frames(), self._camera.masks))
        with (
            stages.measure_garbage_collection(),
            closing(detect_stream(frames, self._detector)) as results,
        ):
            done_s = time.monotonic()
            for frame, found in results:
                if frame is not None:
                    stages.note("waiting for a frame and its detections", time.monotonic() - done_s)
                if self._service.stopping.is_set():
                    break
                with stages.measure("fault check and tracking"):
                    self._check_camera(frame, found)
                    if frame is not None and found is not None:
                        self._update(frame, found)
                    elif frame is not None:
                        self._repeated += 1
                now = self._now_s(frame)
                with stages.measure("states"):
                    if now >= due_s:
                        _finish(publishing)
                        publishing = self._publish("ok" if frame is not None else "no_signal")
                        due_s = (
                            max(due_s, now - self._settings.state_interval_s)
                            + self._settings.state_interval_s
                        )
                    # One segment per frame: all at once would delay the next frames.
                    next(publishing, None)
                    if frame is None:
                        _finish(publishing)
                        if self._fault == "stale":
                            self._previews.publish_past(self._last_frame)
                if frame is not None and now >= preview_due_s:
                    with stages.measure("preview"):
                        self._previews.publish(frame, self._pipeline.tracks, self._latest)
                    preview_due_s = now + 1 / max(self._settings.preview.fps, 1e-3)
                done_s = time.monotonic()
        _finish(publishing)
        self._pipeline.finish_counts()
        _finish(self._publish("ended"))
        self._previews.publish_past(self._last_frame)

    def _now_s(self, frame: Frame | None) -> float:
        """The clock of the state interval: media time of a fast clip, else monotonic time, s."""
        if self._settings.source.pace == "fast" and frame is not None:
            return frame.media_time_s
        return time.monotonic()

    def _check_camera(self, frame: Frame | None, found: Detections | None) -> None:
        """Look for a camera fault; log and count its beginning and its end."""
        now = time.monotonic()
        if found is not None:
            # What starts no track has not been found; a repeated frame shows what the last one did.
            self._boxes = found.boxes_above(HIGH_SCORE)
            self._all_boxes = found.boxes
        fault = (
            self._watch.look(frame, self._boxes, self._all_boxes)
            if frame is not None
            else self._fault_without_frame(now)
        )
        if fault == self._fault:
            return
        if self._fault is not None:
            metrics.FAULT.labels(self._fault).set(0)
            lasted_s = now - self._fault_began_s
            log.warning("the camera's fault is over: %s, %.0f s", self._fault, lasted_s)
        if fault is not None:
            metrics.FAULT.labels(fault).set(1)
            metrics.FAULTS.labels(fault).inc()
            known = f"{fault}: {self._watch.detail}" if self._watch.detail else fault
            log.warning("the camera has a fault: %s; all its segments are unknown", known)
            # Nothing seen while the fault began, or during it, may count later.
            self._pipeline.reset()
            self._standing.forget()
        self._fault, self._fault_began_s = fault, now

    def _fault_without_frame(self, now: float) -> CameraFault | None:
        """The fault while no frame comes; None before the first frame or shortly after one."""
        size_mismatch_s = self._source.counters.size_mismatch_s
        if size_mismatch_s is not None and now - size_mismatch_s < STALE_AFTER_S:
            return "corrupt"
        if self._last_frame is None:
            return None
        return self._watch.absent(now - self._last_frame.captured_s)

    def _update(self, frame: Frame, found: Detections) -> None:
        """Process a frame and its detections, unless the camera has a fault."""
        if self._fault is None:
            self._pipeline.update(frame, self._watch.steady(found))
            if frame.cut:
                self._standing.forget()
        done = time.monotonic()
        self._frames += 1
        self._last_frame = frame
        self._recent.append((done, done - frame.captured_s))
        while self._recent[0][0] < done - _RECENT_S:
            self._recent.popleft()
        metrics.FRAMES.inc()
        metrics.LATENCY.observe(done - frame.captured_s)

    def _publish(self, status: str) -> Iterator[None]:
        """Publish one segment's state at each step and, at the last, the daemon's health."""
        fault = self._fault
        last = self._last_frame
        now = time.monotonic()
        idle_s = now - last.captured_s if last and status != "ok" else 0.0
        time_ns = last.captured_ns if last and status == "ok" else time.time_ns()
        began_ns, self._published_ns = self._published_ns, time.time_ns()
        frames, self._published_frames = self._frames - self._published_frames, self._frames
        states = self._pipeline.iter_states(time_ns, idle_s, fault)
        for _ in self._camera.segments:
            # No span is open while frames are taken in between.
            with span("frames", began_ns, rsu=self._settings.rsu, frames=frames):
                with span("window"):
                    state = next(states)
                with span("publish", rsu=state.rsu, segment=state.segment, sequence=state.sequence):
                    self._state_publishers[state.segment].put(state)
                    # Nothing while nobody can see them: with a fault, or without a frame.
                    if self._fault is None and state.frames:
                        self._standing.publish(self._pipeline.stopped(state))
                    if self._counting is not None:
                        last_s = math.inf if status == "ended" else now
                        self._counting.publish(state.segment, self._pipeline.counts, last_s)
            warn_of_direction(state, self._limiter)
            self._latest[state.segment] = state
            self._states += 1
            metrics.STATES.labels(state.segment, str(state.y_e)).inc()
            yield
            if self._fault != fault:
                break  # the next state would rest on data that is no longer trusted
        if status == "no_signal" and self._limiter.allow("no signal"):
            log.warning("no picture %s", f"for {idle_s:.0f} s" if last else "yet")
        health = self._health(status)
        self._health_publisher.put(health)
        self._log_skipped(health.frames_skipped)
        if self._repeated > _MANY_REPEATS * self._frames and self._limiter.allow("repeated"):
            log.warning(
                "%d pictures show the one before once more and are left out; %d are new",
                self._repeated,
                self._frames,
            )
        metrics.SKIPPED.set(health.frames_skipped)
        metrics.REPEATED.set(health.frames_repeated)
        metrics.DECODE_ERRORS.set(health.decode_errors)
        metrics.RECONNECTS.set(health.reconnects)
        # Connecting to an absent camera is progress too: a restart would not help.
        stall_timeout_s = self._settings.source.stall_timeout_s
        if (
            status == "ok"
            or now - self._source.counters.tried_s < 2 * stall_timeout_s + _RECONNECT_S
        ):
            self._service.progress(f"{status}, {health.fps:.1f} frames a second")

    def _log_skipped(self, skipped: int) -> None:
        """Log which stages took longest, if frames were skipped since the last states."""
        longest = self._stages.report()
        if skipped > self._skipped and self._limiter.allow("skipped"):
            log.warning("%d frames skipped; longest: %s", skipped - self._skipped, longest)
        self._skipped = skipped

    def _health(self, status: str) -> RsuHealth:
        latencies = [1e3 * latency for _, latency in self._recent]
        p50, p95 = np.percentile(latencies, (50, 95)) if latencies else (None, None)
        counters = self._source.counters
        began = self._recent[0][0] if self._recent else 0.0
        span = self._recent[-1][0] - began if self._recent else 0.0
        limits = self._settings.stability
        return RsuHealth(
            rsu=self._settings.rsu,
            time_ns=time.time_ns(),
            started_ns=self._started_ns,
            source=str(next(iter(self._settings.source.clips), "camera")),
            segments=tuple(self._state_publishers),
            status=status,  # type: ignore[arg-type]
            fault=self._fault,
            frames=self._frames,
            frames_skipped=counters.skipped,
            frames_repeated=self._repeated,
            decode_errors=counters.decode_errors,
            reconnects=counters.reconnects,
            states=self._states,
            fps=(len(self._recent) - 1) / span if span > 0 and status == "ok" else 0.0,
            latency_ms_p50=None if p50 is None else float(p50),
            latency_ms_p95=None if p95 is None else float(p95),
            vehicles_in_view=len(self._pipeline.tracks),
            rss_mb=rss_mb(),
            stability=StabilityLimits(
                max_speed_cv=limits.max_speed_cv,
                max_acceleration_variance_m2ps4=limits.max_acceleration_variance_m2ps4,
            ),
            calibration=self._calibration,
        )


def _finish(steps: Iterator[None]) -> None:
    """Run the remaining steps."""
    for _ in steps:
        pass
