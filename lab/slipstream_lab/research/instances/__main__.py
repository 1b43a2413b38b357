"""`python -m slipstream_lab.research.instances FOLDER`: write the published instances anew."""

from __future__ import annotations

import sys
from pathlib import Path

from slipstream_lab.research.instances.publish import publish

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m slipstream_lab.research.instances FOLDER")
    publish(Path(sys.argv[1]))
