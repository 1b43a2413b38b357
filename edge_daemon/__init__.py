"""The daemon of one roadside unit: video in, stability flags of road segments out."""

import os
import sys

# OpenCV reads these once, when it is first imported. Messages of OpenCV and FFmpeg about broken
# streams would flood standard error; the daemon logs one line each.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
# A picture of a few kB may claim to be of 30,000 x 30,000 pixels, 2.7 GB; a camera's are of 33
# million at most.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**26))

# OpenVINO's telemetry writes an identity into the home folder and connects to a server; it does
# neither where its module cannot be imported.
sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]
