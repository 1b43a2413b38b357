"""Why a camera sends no frame: the answer of its server to one plain request."""

from __future__ import annotations

import socket
import ssl
from base64 import b64encode
from urllib.parse import unquote, urlsplit

_PORTS = {"http": 80, "https": 443, "rtsp": 554, "rtsps": 322}
_MAX_ANSWER_BYTES = 4096


def diagnose(url: str, timeout_s: float) -> str:
    """Send the server of an HTTP or RTSP address one request and describe its answer, without the
    password.
    """
    try:
        parts = urlsplit(url)
        port = parts.port or _PORTS[parts.scheme]
        host = parts.hostname or ""
        with socket.create_connection((host, port), timeout_s) as plain:
            connection: socket.socket = plain
            if parts.scheme in ("https", "rtsps"):
                connection = ssl.create_default_context().wrap_socket(plain, server_hostname=host)
            connection.sendall(_request(url).encode())
            answer = connection.recv(_MAX_ANSWER_BYTES)
    except TimeoutError:
        return "the server does not answer"
    except socket.gaierror:
        return "no such host"
    except (OSError, ValueError) as error:
        return f"cannot connect: {getattr(error, 'strerror', None) or error}"
    return _in_words(answer)


def _request(url: str) -> str:
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    if parts.scheme.startswith("rtsp"):
        return f"DESCRIBE {parts._replace(netloc=host).geturl()} RTSP/1.0\r\nCSeq: 1\r\n\r\n"
    path = parts._replace(scheme="", netloc="", path=parts.path or "/").geturl()
    sign = ""
    if parts.username is not None:
        user = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
        sign = f"Authorization: Basic {b64encode(user.encode()).decode()}\r\n"
    return f"GET {path} HTTP/1.0\r\nHost: {host}\r\n{sign}\r\n"


def _in_words(answer: bytes) -> str:
    if not answer:
        return "the server hangs up"
    head = answer.partition(b"\r\n\r\n")[0].decode("latin-1").splitlines()
    version, _, status = head[0].partition(" ")
    if not version.startswith(("HTTP/", "RTSP/")):
        return "no camera answers there"
    if not status.startswith("2"):
        return f"the server says {status.strip()[:60]}"
    for line in head[1:]:
        name, _, value = line.partition(":")
        if name.lower() == "content-type":
            kind = value.strip().partition(";")[0][:40]
            return f"the server sends {kind}, but no picture that can be read"
    return "the server answers, but sends no picture that can be read"
