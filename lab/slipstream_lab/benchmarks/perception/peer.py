"""Ultralytics' `YOLO(...).track()` on a clip: run by the Python that has it, needs nothing of ours.

Prints the moments at which frames were done as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time


def main() -> None:
    """Measure once."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model")
    parser.add_argument("video")
    parser.add_argument("--imgsz", type=int, nargs=2, default=[384, 640])
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--warm-up", type=int, default=20)
    parser.add_argument("--min-score", type=float, default=0.1)
    parser.add_argument(
        "--all-cores", action="store_true", help="left to itself, Ultralytics leaves a core out"
    )
    options = parser.parse_args()
    os.environ["YOLO_OFFLINE"] = "true"
    os.environ["YOLO_AUTOINSTALL"] = "false"
    import torch
    from ultralytics import YOLO

    model = YOLO(options.model, task="detect")
    if options.all_cores:
        cores = len(os.sched_getaffinity(0))
        model.add_callback("on_predict_start", lambda _: torch.set_num_threads(cores))
    results = model.track(
        source=options.video,
        stream=True,
        imgsz=options.imgsz,
        conf=options.min_score,
        device="cpu",
        verbose=False,
        save=False,
    )
    done: list[float] = []
    vehicles = 0
    cpu_s = 0.0
    for number, result in enumerate(results, start=1):
        if number >= options.warm_up:
            done.append(time.monotonic())
        if number == options.warm_up:
            cpu_s = -time.process_time()
        if number > options.warm_up:
            vehicles += len(result.boxes)
        if number == options.warm_up + options.frames:
            break
    cpu_s += time.process_time()
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(json.dumps({"done_s": done, "cpu_s": cpu_s, "vehicles": vehicles, "rss_mb": rss_mb}))


if __name__ == "__main__":
    main()
