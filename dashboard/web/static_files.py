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

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response


class StaticFile(NamedTuple):
    """Something that stays as it is, as it is and compressed."""

    plain: bytes
    packed: bytes
    tag: str
    media_type: str

    @classmethod
    def of(cls, plain: bytes, media_type: str) -> StaticFile:
        """The file of this content."""
        tag = f'"{hashlib.sha256(plain).hexdigest()[:32]}"'
        return cls(plain, gzip.compress(plain, 6, mtime=0), tag, media_type)

    def answer(self, asked: Headers) -> Response:
        """It for a request with these headers: compressed for those who take it, with an ETag."""
        headers = {"ETag": self.tag, "Vary": "Accept-Encoding"}
        known = asked.get("if-none-match", "").split(",")
        if self.tag in (part.strip().removeprefix("W/") for part in known):
            return Response(status_code=304, headers=headers)
        taken = asked.get("accept-encoding", "").lower()
        packed = "gzip" in taken and len(self.packed) < len(self.plain)
        if packed:
            headers["Content-Encoding"] = "gzip"
        content = self.packed if packed else self.plain
        return Response(content, headers=headers, media_type=self.media_type)


class StaticFiles:
    """Files of a folder, as they are when it is opened."""

    def __init__(self, folder: Path) -> None:
        self._files = {
            path.relative_to(folder).as_posix(): _read(path)
            for path in folder.rglob("*")
            if path.is_file()
        }

    # Not a plain function, for which a thread would be taken.
    async def answer(self, request: Request) -> Response:
        """The file of the request's `path`, or else the page.

        Raises:
            HTTPException: 404, there is none.
        """
        file = self._files.get(request.path_params.get("path", "index.html"))
        if file is None:
            raise HTTPException(404)
        return file.answer(request.headers)


def _read(path: Path) -> StaticFile:
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return StaticFile.of(path.read_bytes(), kind)
