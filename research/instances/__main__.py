"""`python -m research.instances FOLDER`: write the published instances anew."""

from __future__ import annotations

import sys
from pathlib import Path

from research.instances.publish import publish

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m research.instances FOLDER")
    publish(Path(sys.argv[1]))
