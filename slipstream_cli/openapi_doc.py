"""The description of the dispatcher's HTTP API, ``docs/openapi.json``, from its routes.

Run as ``python -m slipstream_cli.openapi_doc > docs/openapi.json``. A test holds the committed file
to it.
"""

from __future__ import annotations

import json
import sys

from dispatcher_daemon.service.api import create_app


def document() -> str:
    """The whole file."""
    return json.dumps(create_app().openapi(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(document())
