"""The daemon of one roadside unit: video in, stability flags of road segments out."""

import os
import sys

# OpenCV reads these once, when it is first imported. Messages of OpenCV and FFmpeg about broken
# streams would flood standard error; the daemon logs one line each.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")

# OpenVINO's telemetry writes an identity into the home folder and connects to a server; it does
# neither where its module cannot be imported.
sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
