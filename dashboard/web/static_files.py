"""The page's own files, from memory.

A browser asks for some seventy at once; read from disk, each one waits several times for a thread
and the interpreter's lock, beside those that take in messages.
"""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
from pathlib import Path
from typing import NamedTuple

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response


class _File(NamedTuple):
    plain: bytes
    packed: bytes
    tag: str
    media_type: str


class StaticFiles:
    """Files of a folder, as they are when it is opened.

    Args:
        folder: with all that is below it.
    """

    def __init__(self, folder: Path) -> None:
        self._files = {
            path.relative_to(folder).as_posix(): _read(path)
            for path in folder.rglob("*")
            if path.is_file()
        }

    # Not a plain function, for which a thread would be taken.
    async def answer(self, request: Request) -> Response:
        """The file of the request's `path`, or else the page; compressed for those who take it,
        with an ETag.

        Raises:
            HTTPException: 404, there is none.
        """
        path = request.path_params.get("path", "index.html")
        file = self._files.get(path)
        if file is None:
            raise HTTPException(404)
        headers = {"ETag": file.tag, "Vary": "Accept-Encoding"}
        known = request.headers.get("if-none-match", "").split(",")
        if file.tag in (part.strip().removeprefix("W/") for part in known):
            return Response(status_code=304, headers=headers)
        taken = request.headers.get("accept-encoding", "").lower()
        packed = "gzip" in taken and len(file.packed) < len(file.plain)
        if packed:
            headers["Content-Encoding"] = "gzip"
        content = file.packed if packed else file.plain
        return Response(content, headers=headers, media_type=file.media_type)


def _read(path: Path) -> _File:
    plain = path.read_bytes()
    tag = f'"{hashlib.sha256(plain).hexdigest()[:32]}"'
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return _File(plain, gzip.compress(plain, 6, mtime=0), tag, kind)
