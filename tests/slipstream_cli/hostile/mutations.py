"""Hostile versions of a valid file: damaged, nonsensical, huge, or no file at all."""

from __future__ import annotations

import gzip
import os
import re
import socket
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

_NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?")
_VALUE = re.compile(rb"(?<=[=:])[ \t]*(?:\"[^\"\n]*\"|[-\w.]+|\[[^\[\]\n]*\])")
_HUGE = (
    *(b"-1", b"0", b"1e400", b"-1e308", b"1e-320", b"nan", b"inf", b"-inf", b"NaN", b"Infinity"),
    *(b"9" * 20, b"9" * 400, b"9" * 6000, b"-" + b"9" * 6000, b"0x" + b"f" * 20_000),
    *(b"4294967296", b"2147483648", b"18446744073709551616", b"1" + b"0" * 300 + b".5"),
)
_VALUES = (
    *(b"true", b"false", b"null", b"[]", b"{}", b'""', b'"x"', b"[[]]", b'{"a": 1}', b"1", b"-1.5"),
    *(b'"\\u0000"', b'"a\\u0000b"', b'"\\ud800"', b'"\\u001b[2J"', b"1979-05-27T07:32:00Z"),
    *(
        b'"/dev/zero"',
        b'"/dev/stdin"',
        b'"."',
        b'"/"',
        b'"' + b"../" * 2000 + b'"',
        b'"' + b"x" * 5000,
    ),
    *(b'"' + b"x" * 5000 + b'"', b'"file:///etc/passwd"', b'"\xff\xfe"', b"[" * 900 + b"]" * 900),
    *(b'"sqlite://"', b'"postgresql://h:abc/x"', b'"http://[::"', b'"tcp/"'),
)
_XML_HEAD = b'<?xml version="1.0"?>\n<!DOCTYPE net [\n%s]>\n<net version="1.16">%s</net>\n'


def _flip(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _overwrite(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 4, 16))):
        at = rng.randrange(max(1, len(changed)))
        with_what = rng.choice((b"\0" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\0\0\0", b"\0"))
        changed[at : at + len(with_what)] = with_what
    return bytes(changed)


def _truncate(data: bytes, rng: Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _drop(data: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at + rng.choice((1, 10, 200)) :]


def _repeat(data: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    part = data[at : at + rng.choice((1, 10, 200))]
    return data[:at] + part * rng.choice((2, 10, 5000)) + data[at:]


def _repeat_line(data: bytes, rng: Random) -> bytes:
    """A key twice, a row some thousand times."""
    lines = data.splitlines(keepends=True) or [b""]
    at = rng.randrange(len(lines))
    return b"".join(
        lines[:at] + lines[at : at + rng.choice((1, 4))] * rng.choice((2, 4000)) + lines[at:]
    )


def _swap_lines(data: bytes, rng: Random) -> bytes:
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    return b"".join(lines)


def _number(data: bytes, rng: Random) -> bytes:
    return _replaced(data, _NUMBER, rng.choice(_HUGE), rng)


def _value(data: bytes, rng: Random) -> bytes:
    return _replaced(data, _VALUE, b" " + rng.choice(_VALUES), rng)


def _replaced(data: bytes, pattern: re.Pattern[bytes], new: bytes, rng: Random) -> bytes:
    found = [match.span() for match in pattern.finditer(data)]
    if not found:
        return new
    begin, end = rng.choice(found)
    return data[:begin] + new + data[end:]


def _nuls(data: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + b"\0" * rng.choice((1, 100)) + data[at:]


def _deep(data: bytes, rng: Random) -> bytes:
    depth = rng.choice((300, 990, 3000, 200_000))
    forms: tuple[Callable[[], bytes], ...] = (
        lambda: b".".join([b"a"] * depth) + b" = 1\n" + data,
        lambda: b"[" + b".".join([b"a"] * depth) + b"]\nb = 1\n",
        lambda: b".".join([b'"a b"'] * depth) + b" = 1\n" + data,
        lambda: b"a = " + b"[" * depth + b"]" * depth + b"\n" + data,
        lambda: b"a = " + b"{a = " * depth + b"1" + b"}" * depth + b"\n",
        lambda: b"[" * depth + b"]" * depth,
        lambda: b'{"a":' * depth + b"1" + b"}" * depth,
        lambda: data.rstrip().removesuffix(b"}") + b', "a": ' + b"[" * depth + b"]" * depth + b"}",
        lambda: b"<net>" + b"<edge>" * depth,
        lambda: data.replace(b"</net>", b"<a>" * depth + b"</a>" * depth + b"</net>"),
    )
    return rng.choice(forms)()


def _encoded(data: bytes, rng: Random) -> bytes:
    text = data.decode("utf-8", errors="replace")
    return rng.choice(
        (
            text.encode("utf-16"),
            b"\xef\xbb\xbf" + data,
            data.replace(b"\n", b"\r"),
            data.replace(b"e", b"\xe9"),
            data.replace(b"a", "\u202e".encode()),
            b"\x1b[2J" + data,
        )
    )


def _bulk(data: bytes, rng: Random) -> bytes:
    """Files of some MB in which one thing stands a million times."""
    forms: tuple[Callable[[], bytes], ...] = (
        lambda: b"",
        lambda: b" " * 3_000_000,
        lambda: b"\n" * 3_000_000,
        lambda: b"a" * 3_000_000,
        lambda: b'"' * 3_000_000,
        lambda: b'x = "' + b'\\"' * 1_000_000,
        lambda: b"[[a]]\n" * 400_000,
        lambda: b"".join(b"k%d = 1\n" % i for i in range(200_000)),
        lambda: b"a = [" + b"1," * 1_500_000 + b"]\n",
        lambda: b'{"stops": [' + b"{}," * 1_000_000 + b'{}], "vehicles": [{}], "depots": [{}]}',
        lambda: b'{"stops": [' + b"1," * 1_500_000 + b'1], "vehicles": [1], "depots": [1]}',
        lambda: b"u,v,x,y\n" + b"1,2,3,4\n" * 400_000,
        lambda: b"<net>" + b"<edge/>" * 400_000 + b"</net>",
        lambda: b'<net version="1.0">' + b'<edge id="a" from="b" to="b"/>' * 100_000 + b"</net>",
        lambda: b"<net " + b" ".join(b'a%d="x"' % i for i in range(100_000)) + b"/>",
        lambda: data * max(1, 2_000_000 // max(1, len(data))),
    )
    return rng.choice(forms)()


def _entities(data: bytes, rng: Random) -> bytes:
    laughs = b'<!ENTITY a0 "ha">\n' + b"".join(
        b'<!ENTITY a%d "%s">\n' % (i, b"&a%d;" % (i - 1) * 10) for i in range(1, 12)
    )
    return rng.choice(
        (
            _XML_HEAD % (laughs, b"&a11;"),
            _XML_HEAD % (laughs, b'<edge id="&a9;"/>'),
            _XML_HEAD % (b'<!ENTITY a "' + b"x" * 100_000 + b'">', b"&a;" * 30_000),
            _XML_HEAD % (b'<!ENTITY a SYSTEM "file:///etc/passwd">', b"&a;"),
            _XML_HEAD % (b'<!ENTITY a SYSTEM "file:///dev/zero">', b"&a;"),
            _XML_HEAD % (b'<!ENTITY % a SYSTEM "http://127.0.0.1:9/x"> %a;', b""),
        )
    )


@cache
def bomb(content: bytes) -> bytes:
    """A file of 3 MB that unpacks to 3 GB of one byte."""
    # Members one after another unpack as one file.
    return (
        gzip.compress(b'<net version="1.0">', mtime=0)
        + gzip.compress(content * 100_000_000, mtime=0) * 30
    )


def _packed(data: bytes, rng: Random) -> bytes:
    """Packed, damaged while packed, or a small file that unpacks to gigabytes."""
    packed = gzip.compress(data, mtime=0)
    forms: tuple[Callable[[], bytes], ...] = (
        lambda: packed,
        lambda: _flip(packed, rng),
        lambda: packed[: len(packed) // 2],
        lambda: packed + b"trailing",
        lambda: bomb(b"\0"),
        lambda: bomb(b" "),
    )
    return rng.choice(forms)()


_ANY = (_flip, _overwrite, _truncate, _drop, _repeat, _nuls)
_TEXT = (_repeat_line, _swap_lines, _number, _number, _number, _value, _value, _value, _encoded)
_RARE = (_deep, _bulk, _entities, _packed)
_RARE_SHARE = 0.1


def mutate(data: bytes, rng: Random, *, text: bool) -> tuple[str, bytes]:
    """A hostile version of a file, and what was done to it.

    Args:
        data: the valid file.
        rng: the same one gives the same version.
        text: whether the file is one for people to write.
    """
    usual = (*_ANY, *_TEXT) if text else _ANY
    names = []
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        change: Callable[[bytes, Random], bytes] = rng.choice(
            _RARE if rng.random() < _RARE_SHARE else usual
        )
        names.append(change.__name__.strip("_"))
        data = change(data, rng)
        if len(data) > 100_000:
            break
    return ", ".join(names), data


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


def _socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # the name of a socket is short
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(20_000_000_000)


NO_FILES: dict[str, Callable[[Path], None]] = {
    "pipe": lambda path: os.mkfifo(path),
    "directory": lambda path: path.mkdir(),
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "/dev/full": lambda path: path.symlink_to("/dev/full"),
    "/proc/self/mem": lambda path: path.symlink_to("/proc/self/mem"),
    "broken link": lambda path: path.symlink_to("nowhere"),
    "link to itself": _loop,
    "socket": _socket,
    "20 GB of zeros": _sparse,
    "nothing": lambda path: None,
}
"""What may stand where a file is expected, and how it gets there."""


def huge_png(width: int, height: int) -> bytes:
    """A black picture of one bit a pixel: of 30,000 x 30,000 it takes 110 kB."""
    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    packer = zlib.compressobj(9)
    row = bytes(1 + (width + 7) // 8)
    rows = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    chunks = ((b"IHDR", header), (b"IDAT", rows), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


def of_size(jpeg: bytes, width: int, height: int) -> bytes:
    """JPEG pictures, alone or in a video, that claim another size."""
    return re.sub(
        rb"(?s)(\xff[\xc0-\xc2]\x00\x11\x08)....",
        lambda match: match[1] + struct.pack(">HH", height, width),
        jpeg,
    )


def known_attacks(folder: Path) -> list[tuple[str, str, bytes]]:
    """Files that once ended in a traceback, a hang or gigabytes: kind, name and content.

    Args:
        folder: of valid files.
    """
    picture, video = (folder / name for name in ("picture.jpg", "video.avi"))
    laughs = b'<!ENTITY a0 "ha">' + b"".join(
        b'<!ENTITY a%d "%s">' % (i, b"&a%d;" % (i - 1) * 10) for i in range(1, 12)
    )
    return [
        ("picture", "picture.png", huge_png(30_000, 30_000)),
        ("picture", "picture.jpg", of_size(picture.read_bytes(), 30_000, 30_000)),
        ("video", "video.avi", of_size(video.read_bytes(), 30_000, 30_000)),
        ("video", "video.mp4", huge_png(30_000, 30_000)),
        ("tracked video", "video.mp4", huge_png(30_000, 30_000)),
        ("net (packed)", "net.net.xml.gz", bomb(b" ")),
        ("net (packed)", "net.net.xml.gz", bomb(b"\0")),
        ("net", "net.net.xml", _XML_HEAD % (laughs, b"&a11;")),
        ("net", "net.net.xml", b'<net version="1.0">' + b"<edge/>" * 9_000_000),
        ("net", "net.net.xml", b'<net version="1.0">' + b"<lane/>" * 9_000_000),
        ("routes", "routes.rou.xml", b"<routes>" + b"<a/>" * 9_000_000),
        ("fleet (JSON)", "fleet.json", b'{"stops": [' + b"{}," * 2_600_000 + b"{}]}"),
        ("fleet (JSON)", "fleet.json", b'{"stops": [' + b"[]," * 2_600_000 + b"[]]}"),
        ("fleet (JSON)", "fleet.json", b'{"stops": [' + b"1," * 3_990_000 + b"1]}"),
        ("instance", "instance.json", b'{"a":' * 3000 + b"1" + b"}" * 3000),
    ]
