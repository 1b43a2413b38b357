"""The files of the bus beside a ``site.toml``: a password for each user, and what the router lets
each camera, process of agents and box do (``access.json``).

It needs Python alone: `deploy/install.sh` runs this file before anything is installed.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import sys
import tomllib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

ACCESS: Final = "access.json"
"""Beside ``router.json5``; the router adds its rules to those that are there."""
USER: Final = re.compile(r"[A-Za-z0-9_-]{1,31}")
"""What systemd takes for a user's name."""

_ROOT: Final = "slipstream/v1"
_ASK: Final = (
    "declare_subscriber",
    "query",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
_SAY: Final = ("put", "delete", "reply", "declare_queryable", "liveliness_token")
# Keys after the root; + stands for a key and what publishers keep of it, V for a vehicle. A
# wildcard does not reach chunks that begin with @, where caches and heartbeats live.
_OF_ALL_ROADS: Final = ("platoon/*/*", "signal/*/spat", "signal/*/status", "rsu/*/segment/*/state")
_OF_SEGMENTS: Final = ("state", "stopped", "counts", "counts/running")
_SENSED: Final = ("vehicle/V/sensing", "vehicle/V/driver")
_ADVICE: Final = ("vehicle/V/advice",)
_HEARD: Final = ("fleet/V/plan+", "fleet/V/platooning/*")
_SAID: Final = (
    "fleet/V/position",
    "fleet/V/acknowledgement+",
    "fleet/V/progress+",
    "fleet/*/platooning/V",
    "platoon/*/V",
    "signal/*/request/V",
)

Table = Mapping[str, Any]


def bus_users(tables: Table) -> tuple[str, ...]:
    """Users of the router of this machine that the tables of a ``site.toml`` ask for."""
    server = ("dispatcher", "fleet", "signals") if "dispatcher" in tables else ()
    page = ("dashboard",) if "dashboard" in tables else ()
    cameras = (f"edge-{name}" for name, own in _table(tables, "rsus") if _is_here(own))
    agents = (
        f"{who}-{name}"
        for name, own in _table(tables, "agents")
        if "box" not in own
        for who in ("agent", "vehicle")
    )
    boxes = (
        own["box"]
        for table in ("rsus", "agents")
        for _, own in _table(tables, table)
        if "box" in own
    )
    return tuple(dict.fromkeys((*server, *page, *cameras, *agents, *boxes)))


def access_of(tables: Table, root: Path = Path("/")) -> dict[str, list[dict[str, Any]]]:
    """Rules, subjects and policies of zenoh's access control for the instances of a site.

    Args:
        root: below which a camera's calibration is, which has the segments of an RSU without any.
    """
    rules = _shared_rules()
    subjects: dict[str, dict[str, Any]] = {}
    policies: dict[str, list[str]] = {}

    def allow(user: str, own: Table, *names: str) -> None:
        policies.setdefault(user, []).extend(n for n in names if n not in policies[user])
        subjects[user] = {"id": user, "usernames": [user]} | (
            {"cert_common_names": [user], "link_protocols": ["tls"]}
            if "box" in own
            else {"interfaces": ["lo"], "link_protocols": ["tcp"]}
        )

    for name, own in _table(tables, "rsus"):
        if not ("box" in own or _is_here(own)):
            continue
        said = f"keys of {name}"
        rules[said] = _rule(said, "ingress", _SAY, _keys_of_rsu(name, _segments(own, root)))
        if "box" in own:
            allow(own["box"], own, "being asked for what RSUs publish", said)
        else:
            allow(f"edge-{name}", own, "being asked", said)
    for name, own in _table(tables, "agents"):
        here = "box" not in own
        vehicles = [vehicle["id"] for vehicle in own.get("vehicles", ())]
        user = f"agent-{name}" if here else own["box"]
        heard, said = f"heard by agent-{name}", f"keys of agent-{name}"
        sensed, advice = (_SENSED, _ADVICE) if here else ((), ())
        rules[heard] = _rule(heard, "egress", _SAY, _of(vehicles, (*_HEARD, *sensed)))
        rules[said] = _rule(said, "ingress", _SAY, _of(vehicles, (*_SAID, *advice)))
        where = "agents hear" if here else "a vehicle's box hears"
        being = "being asked" if here else "being asked for what agents publish"
        roads = "hearing roads, signals and platoons"
        allow(user, own, being, f"asking for what {where}", roads, heard, said)
        if here:
            user = f"vehicle-{name}"
            heard, said = f"heard by {user}", f"keys of {user}"
            rules[heard] = _rule(heard, "egress", _SAY, _of(vehicles, _ADVICE))
            rules[said] = _rule(said, "ingress", _SAY, _of(vehicles, _SENSED))
            allow(user, own, "being asked", "asking for advice", heard, said)
    used = {name for names in policies.values() for name in names}
    return {
        "rules": [rule for name, rule in rules.items() if name in used],
        "subjects": [*subjects.values()],
        "policies": [{"rules": names, "subjects": [user]} for user, names in policies.items()],
    }


def prepare(site: Path, root: Path = Path("/")) -> tuple[str, ...]:
    """Make what is missing, and the rules as the site has them; passwords that are there stay.

    Args:
        root: below which systemd's units are.

    Returns:
        What has changed, in words: the router has to be started anew then. Nothing: all was so.
    """
    tables = tomllib.loads(site.read_text(encoding="utf-8"))
    users = bus_users(tables)
    for user in users:
        if not user.isprintable() or {*user} & {*":/"}:
            raise ValueError(
                f"{user!r} is no user's name on the bus; take letters, digits, - and _"
            )
    changed = [*_passwords(site.parent / "bus", users)]
    for user in users:
        changed += _drop_in(user, root)
    if users:
        text = json.dumps(access_of(tables, root), indent=1) + "\n"
        path = site.parent / ACCESS
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            write_private(path, text)
            changed.append(f"{path}: rules for {', '.join(users)}")
    return tuple(changed)


def forget(folder: Path, users: Sequence[str]) -> None:
    """Take users' passwords away."""
    path = folder / "users"
    if path.exists():
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        write_private(path, "".join(x for x in lines if x.partition(":")[0] not in users))
    for user in users:
        (folder / user).unlink(missing_ok=True)


def write_private(path: Path, text: str) -> None:
    """Write a file as a whole; a new one is its owner's alone, of another owner and mode stay."""
    new = path.with_name(f"{path.name}.new")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            if path.exists():
                former = path.stat()
                os.fchown(descriptor, former.st_uid, former.st_gid)
                os.fchmod(descriptor, former.st_mode & 0o777)
            file.flush()
            os.fsync(descriptor)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _passwords(folder: Path, users: Sequence[str]) -> Iterator[str]:
    """A line among the router's users counts; whoever has none gets a random password."""
    if not users:
        return
    folder.mkdir(mode=0o700, exist_ok=True)
    path = folder / "users"
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    known = dict(line.split(":", 1) for line in text.splitlines() if ":" in line)
    made = {user: secrets.token_hex(24) for user in users if not known.get(user)}
    if made or not path.exists():
        lines = "".join(f"{user}:{password}\n" for user, password in made.items())
        write_private(path, f"{text.rstrip()}\n{lines}".lstrip())
        yield f"{path}: passwords of {', '.join(made)}"
    for user in users:
        own, password = folder / user, (known | made)[user]
        if not own.exists() or own.read_text(encoding="utf-8") != f"{password}\n":
            write_private(own, f"{password}\n")
            if user not in made:
                yield f"{own}: the password of {path}"


def _drop_in(user: str, root: Path) -> Iterator[str]:
    """A unit's User= is edge-NAME or agent-NAME; where that is no user's name, a number is."""
    daemon, _, name = user.partition("-")
    if daemon not in ("edge", "agent") or USER.fullmatch(user):
        return
    path = root / "etc/systemd/system" / f"slipstream-{daemon}@{name}.service.d" / "user.conf"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"[Service]\nUser={daemon}-{zlib.crc32(user.encode())}\n")
        yield f"{path}: a user for its unit"


def _table(tables: Table, name: str) -> Iterator[tuple[str, Table]]:
    yield from tables.get(name, {}).items()


def _is_here(own: Table) -> bool:
    """Whether an RSU's camera is this machine's."""
    return "box" not in own and ("camera" in own or "source" in own)


def _segments(own: Table, root: Path) -> Sequence[str]:
    if "segments" in own or "camera" not in own:
        return tuple(own.get("segments", ()))
    path = root / own["camera"].lstrip("/") if own["camera"].startswith("/") else own["camera"]
    try:
        segments = tomllib.loads(Path(path).read_text(encoding="utf-8")).get("segments", ())
        return [str(segment["id"]) for segment in segments]
    except (OSError, ValueError, KeyError, TypeError):
        text = "cannot be read: the router takes no states of its segments"
        print(f"{path} {text}; give segments in site.toml", file=sys.stderr)
        return ()


def _rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": [*messages],
        "key_exprs": [*keys],
    }


def _expressions(keys: Sequence[str]) -> list[str]:
    found = []
    for key in keys:
        found.append(f"{_ROOT}/{key.rstrip('+')}")
        if key.endswith("+"):
            found.append(f"{found[-1]}/@adv/**")
    return found


def _keys_of_rsu(name: str, segments: Sequence[str]) -> list[str]:
    rsu = f"rsu/{quote(name, safe='')}"
    own = [f"{rsu}/segment/{quote(segment, safe='')}" for segment in segments]
    return _expressions(
        (
            f"{rsu}/health+",
            f"{rsu}/preview/**",
            *(f"{segment}/{what}+" for segment in own for what in _OF_SEGMENTS),
        )
    )


def _of(vehicles: Sequence[str], keys: Sequence[str]) -> list[str]:
    return _expressions(
        [
            "/".join(
                quote(vehicle, safe="") + part[1:] if part[:1] == "V" else part for part in parts
            )
            for vehicle in vehicles
            for parts in (key.split("/") for key in keys)
        ]
    )


def _shared_rules() -> dict[str, dict[str, Any]]:
    """Rules of several users, by their names, those of `router.json5` where it has them too."""
    every = ("**", "**/@adv/**")
    rsus = ("rsu/**", "rsu/**/@adv/**")
    agents = ("fleet/**", "fleet/**/@adv/**", "platoon/**", "signal/*/request/*")
    hears = [key.replace("V", "*") for key in (*_HEARD, *_OF_ALL_ROADS)]
    sensed = [key.replace("V", "*") for key in _SENSED]
    # Publishers learn from being asked that somebody listens, and are asked for what they have
    # kept. Asking reaches further than hearing: what a vehicle hears of plans is its own only.
    rules = (
        ("being asked", "egress", _ASK, every),
        ("being asked for what RSUs publish", "egress", _ASK, rsus),
        ("being asked for what agents publish", "egress", _ASK, agents),
        ("asking for what agents hear", "ingress", _ASK, (*hears, *sensed)),
        ("asking for what a vehicle's box hears", "ingress", _ASK, hears),
        ("hearing roads, signals and platoons", "egress", _SAY, _OF_ALL_ROADS),
        ("asking for advice", "ingress", _ASK, ("vehicle/*/advice",)),
    )
    return {name: _rule(name, flow, what, _expressions(keys)) for name, flow, what, keys in rules}


def main(arguments: Sequence[str]) -> int:
    """Prepare a site's files; with a folder, units are below it."""
    try:
        for line in prepare(Path(arguments[0]), Path(arguments[1] if arguments[1:] else "/")):
            print(line)
    except (OSError, ValueError) as error:
        print(f"{arguments[0]}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
