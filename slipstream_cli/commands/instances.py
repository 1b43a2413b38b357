"""`slipstream rsu` and `slipstream agent add`: one more camera or process of agents in one command,
with its table, its user on the bus, the router's rules and its unit.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from slipstream.config import MAX_TOML_BYTES
from slipstream.errors import InputError
from slipstream.files import read_text
from slipstream.site import NAMED, read_site
from slipstream_cli.place.bus_files import bus_users, forget, prepare, write_private
from slipstream_cli.place.site_file import words_of

_INSTALLED: Final = Path("/etc/slipstream/site.toml")
_UNITS: Final = Path("/run/systemd/system")
_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,25}")
_HEADER: Final = re.compile(r"\s*\[\[?\s*(?P<path>[^\]\[#]+?)\s*\]\]?\s*(#.*)?")
_FIRST_METRICS_PORT: Final = 9464
_GREEN_WITHIN_S: Final = 60.0
_LISTEN_S: Final = 3.0
_RSU, _AGENT = "rsu", "agent"
_TABLE: Final = {_RSU: NAMED["edge"][0], _AGENT: NAMED["agent"][0]}
_DAEMON: Final = {_RSU: "edge", _AGENT: "agent"}


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `slipstream rsu`."""
    command = commands.add_parser("rsu", help="add a roadside unit to a site, or remove one")
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    add = add_actions(actions, _RSU)
    add.add_argument("--camera", type=Path, metavar="FILE", help="its calibration, a camera.toml")
    source = add.add_mutually_exclusive_group()
    source.add_argument("--url", help="RTSP or HTTP MJPEG; '-' reads it from standard input")
    source.add_argument("--clip", type=Path, metavar="FILE", help="a recorded clip, over and over")
    add.add_argument(
        "--segments",
        nargs="+",
        metavar="ID",
        help="road segments that it watches (default: those of its calibration)",
    )
    add.add_argument(
        "--box",
        metavar="NAME",
        help="on the server: the box that it runs on, by its certificate's name (default: none, "
        "it runs here)",
    )


def add_agent_actions(command: argparse.ArgumentParser) -> None:
    """Add `add`, `remove` and `apply` to `slipstream agent`."""
    add = add_actions(command.add_subparsers(dest="action", metavar="ACTION"), _AGENT)
    add.add_argument(
        "--vehicles", nargs="+", required=True, metavar="ID", help="as in the fleet's file"
    )
    add.add_argument(
        "--type", metavar="PRESET", help="of these vehicles, as in the fleet's file (default: none)"
    )
    add.add_argument(
        "--box",
        metavar="NAME",
        help="on the server: the vehicle's box that they run on, by its certificate's name "
        "(default: none, they run here)",
    )


def add_actions(
    actions: argparse._SubParsersAction[argparse.ArgumentParser], kind: str
) -> argparse.ArgumentParser:
    """Add what both have; returns the parser of `add`."""
    what = "roadside unit" if kind == _RSU else "process of agents"
    add = actions.add_parser(
        "add",
        help=f"add a {what} to the site",
        description=f"Adds the table of a {what} to site.toml, after the checks of `slipstream "
        "check`; makes its password on the bus and the router's rules for its keys. On an "
        "installed machine it restarts the router, starts the unit and waits until `slipstream "
        "status` finds it well; the exit status is 1 if it does not.",
    )
    remove = actions.add_parser(
        "remove",
        help=f"remove a {what}",
        description=f"Stops the unit of a {what} and removes its table, user and rules.",
    )
    apply = actions.add_parser(
        "apply",
        help="after site.toml was edited: users and rules as it says",
        description="Makes passwords on the bus and the router's rules for what site.toml has, and "
        "restarts the router if something has changed.",
    )
    for action, run in ((add, run_add), (remove, run_remove), (apply, run_apply)):
        if action is not apply:
            action.add_argument("name", metavar="NAME", help="letters, digits, '-' and '_'")
        action.add_argument(
            "--config", type=Path, default=_INSTALLED, help=f"the site.toml (default: {_INSTALLED})"
        )
        action.set_defaults(run=run, kind=kind)
    return add


def run_add(options: argparse.Namespace) -> int:
    """Add one; nothing is changed unless all of the result is valid."""
    site, kind, name = options.config.absolute(), options.kind, options.name
    live = _check_machine(site)
    tables = read_site(site)
    key = f"{_TABLE[kind]}.{name}"
    if not _NAME.fullmatch(name):
        mend = "take 1 to 25 letters, digits, '-' and '_'"
        raise InputError("NAME", f"{name!r} is no name of a unit's user", mend)
    if name in tables.get(_TABLE[kind], {}):
        raise InputError(site, "there is one of this name", "take another name", key=key)
    if live and options.box is None:
        _check_unit(kind)
    table = _rsu_table(options, live) if kind == _RSU else _agent_table(options, site)
    if options.box is None:
        table["metrics_port"] = _free_port(tables)
    before = read_text(site, MAX_TOML_BYTES, "TOML")
    _write_checked(site, f"{before.rstrip()}\n\n{_toml(key, table)}")
    print(f"{site}: [{key}]")
    _prepare(site, tables)
    if live:
        _restart(kind)
    if options.box is not None:
        _print_for_box(options, site)
        return 0
    if live:
        _systemctl("enable", "--now", _unit(kind, name))
    _print_for_server(options, site, table)
    if live:
        return _wait_until_well(kind, name)
    words = words_of(site, _DAEMON[kind], name)
    print(f"start it: slipstream {shlex.join(words)}; restart what runs by this file")
    return 0


def run_remove(options: argparse.Namespace) -> int:
    """Remove one."""
    site, kind, name = options.config.absolute(), options.kind, options.name
    live = _check_machine(site)
    tables = read_site(site)
    key = f"{_TABLE[kind]}.{name}"
    if name not in tables.get(_TABLE[kind], {}):
        known = ", ".join(tables.get(_TABLE[kind], {})) or "none"
        raise InputError(site, f"no such table; there are: {known}", "give one of them", key=key)
    before = read_text(site, MAX_TOML_BYTES, "TOML")
    _write_checked(site, without_table(before, (_TABLE[kind], name)))
    print(f"{site}: without [{key}]")
    if live and "box" not in tables[_TABLE[kind]][name]:
        _systemctl("disable", "--now", _unit(kind, name))
    gone = {*bus_users(tables)} - {*bus_users(read_site(site))}
    forget(site.parent / "bus", [*gone])
    _prepare(site, tables)
    if live:
        _restart(kind)
    return 0


def run_apply(options: argparse.Namespace) -> int:
    """Make users and rules of what the file has."""
    site = options.config.absolute()
    live = _check_machine(site)
    if _prepare(site, read_site(site)) and live:
        _restart(options.kind)
    return 0


def without_table(text: str, path: tuple[str, str]) -> str:
    """A TOML file without a table and those below it; comments before the next one stay."""
    kept: list[str] = []
    cut: list[str] = []
    inside = False
    for line in text.splitlines(keepends=True):
        header = _HEADER.fullmatch(line.rstrip("\n"))
        if header is not None:
            parts = tuple(part.strip().strip("'\"") for part in header["path"].split(".", 2)[:2])
            was, inside = inside, parts == path
            if was and not inside:
                kept += _head_of_next(cut)
            if inside and not was:
                cut = []
                while kept and not kept[-1].strip():
                    kept.pop()
        (cut if inside else kept).append(line)
    return "".join(kept)


def _head_of_next(cut: Sequence[str]) -> Sequence[str]:
    """Comments at the end of a table, which belong to the one that follows."""
    at = len(cut)
    while at and (not cut[at - 1].strip() or cut[at - 1].lstrip().startswith("#")):
        at -= 1
    return cut[at:]


def _check_machine(site: Path) -> bool:
    """Whether this changes what systemd runs here."""
    if site != _INSTALLED:
        return False
    if os.geteuid() != 0:
        raise InputError(site, "only root may change what is installed", "run it with sudo")
    return _UNITS.is_dir()


def _check_unit(kind: str) -> None:
    unit = f"slipstream-{_DAEMON[kind]}@.service"
    if subprocess.run(["systemctl", "cat", unit], capture_output=True, check=False).returncode:
        role = "edge" if kind == _RSU else "agent"
        mend = f"run install.sh {role} here, or give the --box that it runs on"
        raise InputError(unit, "this machine has no such unit", mend)


def _rsu_table(options: argparse.Namespace, live: bool) -> dict[str, Any]:
    if options.box is not None:
        if options.camera or options.url or options.clip or not options.segments:
            problem = "the server needs the segments of another box's unit, and nothing else of it"
            raise InputError("--box", problem, "give --segments alone beside it")
        return {"segments": options.segments, "box": options.box}
    if options.camera is None or (options.url is None and options.clip is None):
        problem = "its calibration and its source are needed"
        raise InputError("rsu add", problem, "give --camera and --url or --clip, or a --box")
    from edge_daemon.camera import load_camera

    camera = options.camera.absolute()
    loaded = load_camera(camera)
    url = sys.stdin.readline().strip() if options.url == "-" else options.url
    clip = None if options.clip is None else options.clip.absolute()
    if live:
        for path in (camera, clip):
            _check_readable(path)
    return {
        "segments": options.segments or [segment.id for segment in loaded.segments],
        "camera": str(camera),
        "source": {"clip": str(clip), "loop": True} if url is None else {"url": url},
    }


def _agent_table(options: argparse.Namespace, site: Path) -> dict[str, Any]:
    kind = {} if options.type is None else {"type": {"preset": options.type}}
    vehicles = [{"id": vehicle, **kind} for vehicle in options.vehicles]
    if options.box is not None:
        return {"box": options.box, "vehicles": vehicles}
    installed = Path("/var/lib/slipstream-agent")
    state = (installed if site == _INSTALLED else site.parent / "agents") / options.name
    return {"state": str(state), "vehicles": vehicles}


def _check_readable(path: Path | None) -> None:
    """Check that a unit's own user may read a file."""
    if path is None:
        return
    hidden = path.is_relative_to("/home") or path.is_relative_to("/root")
    try:
        found = path.stat()
    except OSError as error:
        raise InputError(path, error.strerror or "not readable", "check the path") from None
    of_group = found.st_mode & stat.S_IRGRP and found.st_gid == _INSTALLED.parent.stat().st_gid
    if hidden or not (found.st_mode & stat.S_IROTH or of_group):
        to = _INSTALLED.parent / path.name
        mend = f"put it elsewhere: install -m 640 -g slipstream {shlex.quote(str(path))} {to}"
        raise InputError(path, "the daemon's user cannot read it", mend)


def _free_port(tables: Mapping[str, Any]) -> int:
    """The first port that no daemon of the file has and nobody listens on."""
    from slipstream_cli.checks.site import ports_of

    taken = {port for _, port in ports_of(tables)}
    for port in range(_FIRST_METRICS_PORT, 65536):
        with socket.socket() as probe:
            if port not in taken and probe.connect_ex(("127.0.0.1", port)) != 0:
                return port
    raise InputError("metrics_port", "no port is free", "stop what listens on them")


def _toml(key: str, table: Mapping[str, Any]) -> str:
    """A table with those below it."""
    from slipstream_cli.place.commented import toml

    lines = [f"[{key}]"]
    lines += [f"{name} = {toml(v)}" for name, v in table.items() if not _is_table(v)]
    for name, value in table.items():
        for below in value if name == "vehicles" else [value] if _is_table(value) else []:
            head = f"[[{key}.{name}]]" if name == "vehicles" else f"[{key}.{name}]"
            lines += ["", head, *(f"{k} = {toml(v)}" for k, v in below.items())]
    return "\n".join(lines) + "\n"


def _is_table(value: object) -> bool:
    rows = isinstance(value, list) and value and isinstance(value[0], Mapping)
    return isinstance(value, Mapping) or bool(rows)


def _write_checked(site: Path, text: str) -> None:
    """Write the file in one step if it passes the checks of `slipstream check`."""
    from slipstream_cli.checks.site import check_site

    candidate = site.with_name(f"{site.name}.candidate")
    try:
        write_private(candidate, text)
        try:
            check_site(candidate, None)
        except InputError as error:
            source = site if error.source == str(candidate) else error.source
            problem = error.problem.replace(str(candidate), str(site))
            raise InputError(source, problem, error.mend, key=error.key) from None
        write_private(site, text)
    except OSError as error:
        problem = error.strerror or "not writable"
        raise InputError(site.parent, problem, "run it as who may write there") from None
    finally:
        candidate.unlink(missing_ok=True)


def _prepare(site: Path, tables: Mapping[str, Any]) -> bool:
    """Users and rules of the bus, where it has passwords; whether something has changed."""
    if "password_file" not in tables.get("bus", {}):
        return False
    try:
        changed = prepare(site)
    except (OSError, ValueError) as error:
        raise InputError(site.parent, str(error), "then run slipstream rsu apply") from None
    for line in changed:
        print(line)
    return bool(changed)


def _restart(kind: str) -> None:
    _systemctl("daemon-reload")
    # Its rules cannot change while it runs; daemons connect again by themselves.
    _systemctl("restart", "slipstream-router")
    if kind == _RSU:
        _systemctl("try-restart", "slipstream-dispatcher", "slipstream-dashboard")


def _systemctl(*words: str) -> None:
    print(f"systemctl {' '.join(words)}", flush=True)
    done = subprocess.run(["systemctl", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(f"systemctl {' '.join(words)}: {' '.join(done.stderr.split())}")


def _unit(kind: str, name: str) -> str:
    return f"slipstream-{_DAEMON[kind]}@{name}"


def _print_for_box(options: argparse.Namespace, site: Path) -> None:
    password = site.parent / "bus" / options.box
    if password.exists():
        print(f"password of {options.box}: {password}; it stands in router.json5 of that box")
    words = (
        "rsu add NAME --camera FILE --url URL"
        if options.kind == _RSU
        else f"agent add NAME --vehicles {shlex.join(options.vehicles)}"
    )
    print(f"on {options.box}: slipstream {words.replace('NAME', options.name)}")


def _print_for_server(options: argparse.Namespace, site: Path, table: Mapping[str, Any]) -> None:
    """What the server needs to know of one that was added on a box."""
    box = _box_of(site.parent / "router.json5")
    if box is None:
        return
    what, ids = ("segments", table["segments"]) if "segments" in table else ("vehicles", [])
    ids = ids or options.vehicles
    words = f"{options.kind} add {options.name} --box {box} --{what} {shlex.join(ids)}"
    print(f"on the server: slipstream {words}")


def _box_of(router: Path) -> str | None:
    """Whom a box's router connects to the server as; None: it is no box's."""
    if not router.exists():
        return None
    from slipstream.bus.zenoh_config import read_config

    config = read_config(router)
    if not json.loads(config.get_json("connect/endpoints")):
        return None
    return json.loads(config.get_json("transport/auth/usrpwd/user")) or "BOX"


def _wait_until_well(kind: str, name: str) -> int:
    """Wait until `slipstream status` finds it well, and print what it says of it."""
    deadline, found = time.monotonic() + _GREEN_WITHIN_S, [("unknown", name, "not found")]
    while time.monotonic() < deadline:
        found = [*_findings(kind, name)]
        if len(found) > 1 and all(state == "ok" for state, _, _ in found):
            break
    for state, what, text in found:
        print(f"{state}  {what}  {text}")
    return 0 if all(state == "ok" for state, _, _ in found) else 1


def _findings(kind: str, name: str) -> Iterator[tuple[str, str, str]]:
    status = [sys.executable, "-m", "slipstream_cli", "status", "--json"]
    told = subprocess.run(
        [*status, "--seconds", str(_LISTEN_S)], capture_output=True, text=True, check=False
    )
    names = {f"{_DAEMON[kind]} {name}", f"{_unit(kind, name)}.service"}
    names |= {f"RSU {name}"} if kind == _RSU else set()
    states = {True: "ok", False: "FAULT", None: "unknown"}
    for finding in json.loads(told.stdout or '{"findings": []}')["findings"]:
        if finding["name"] in names:
            yield states[finding["well"]], finding["name"], finding["text"]
