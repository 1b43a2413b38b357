"""What the site shows four times a second, as an operator, a caller and a vehicle see it."""

from __future__ import annotations

import json
import threading
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.http.client import ApiClient
from slipstream.messages import ALL_STATES, CAMERA_FAULTS, SegmentState, decode

_PERIOD_S: Final = 0.25
_WITHIN_S: Final = 1.0
_FRESH_S: Final = 2.5
"""Age of a state: they come each second."""
_HEARD_S: Final = 6.0
"""Age of a vehicle's report: on the road they come each second, else every few."""


@dataclass
class Seen:
    """The latest look. Times are UTC, s.

    Attributes:
        cycle_began_s: of the newest cycle that ended well.
        heard_s: by what is heard, the moment that the oldest of all roads' states, of all
            vehicles' reports and of what the page was sent is from.
        cycles: numbers of all that the API has shown.
        lacks: what does not answer or is old, in words; empty: all is there.
        stable: where each road is shown as stable, or open to platoons.
        latest_began_s: of the newest cycle of all.
        opened: roads that it has opened to platoons.
    """

    at_s: float = 0.0
    cycle_began_s: float = 0.0
    cycles: set[int] = field(default_factory=set)
    lacks: tuple[str, ...] = ("nothing was looked at yet",)
    heard_s: dict[str, float] = field(default_factory=dict)
    stable: dict[str, tuple[str, ...]] = field(default_factory=dict)
    latest_began_s: float = 0.0
    opened: frozenset[str] = frozenset()

    def why_unwell(self, since_s: float) -> str | None:
        """What is not well again since a moment, in words; None: all is."""
        if self.at_s < since_s:
            return "not looked at yet"
        # What died a moment ago is not old yet: each has to have said something since.
        silent = [f"{what}: nothing since" for what, at in self.heard_s.items() if at < since_s]
        if lacks := (*self.lacks, *silent):
            return "; ".join(lacks)
        return None if self.cycle_began_s >= since_s else "no cycle has begun since and ended well"


class Watch:
    """Looks at the API, the page and the bus in a thread of its own; a context manager.

    Attributes:
        seen: the latest look; a new one each time.
    """

    def __init__(
        self, api: str, page: str, token: str, bus: Bus, look: Callable[[Seen], None]
    ) -> None:
        self.seen = Seen()
        self._api, self._token, self._look = ApiClient(api, "the API"), token, look
        self._page = PageFollower(page)
        self._states: dict[str, tuple[float, SegmentState]] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        bus.subscribe(ALL_STATES, self._on_state, history=False, every=True)

    def __enter__(self) -> Watch:
        self._page.start()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._page.stop()
        self._thread.join()

    def _on_state(self, key: str, payload: bytes) -> None:
        state = decode(SegmentState, payload, key)
        self._states[state.segment] = time.monotonic(), state

    def _run(self) -> None:
        while not self._ended.wait(_PERIOD_S):
            self.seen = self._take(self.seen)
            self._look(self.seen)

    def _take(self, before: Seen) -> Seen:
        now_s = time.time()
        seen = Seen(now_s, before.cycle_began_s, before.cycles, lacks=())
        lacks: list[str] = []
        stable: dict[str, list[str]] = {}
        for segment, (at_s, state) in list(self._states.items()):
            if state.y_e == 1 and time.monotonic() - at_s < _FRESH_S:
                stable.setdefault(segment, []).append("bus")
        try:
            self._ask(seen, lacks, stable)
        except InputError as error:
            lacks.append(f"API: {error.problem}")
        roads, rsus = self._page.roads, self._page.rsus
        seen.heard_s["page"] = self._page.heard_s
        if not rsus or seen.at_s - self._page.heard_s > _FRESH_S + 2.0:
            lacks.append("page: nothing is sent")
        elif bad := [name for name, row in rsus.items() if row["fps"] is None or row["faults"]]:
            lacks.append(f"page: {', '.join(sorted(bad))} not well")
        else:
            for segment, row in roads.items():
                if row["flag"] == "stable" or row["gate"] == "open":
                    stable.setdefault(segment, []).append("page")
        seen.lacks = tuple(lacks)
        seen.stable = {segment: tuple(where) for segment, where in stable.items()}
        return seen

    def _ask(self, seen: Seen, lacks: list[str], stable: dict[str, list[str]]) -> None:
        segments = self._get("/v1/segments")["segments"]
        if not segments:
            lacks.append("API: no segment is watched")
        for one in segments:
            state = max(one["states"], key=lambda each: int(each["time_ns"]))
            seen.heard_s[one["id"]] = state["time_ns"] / 1e9
            if abs(seen.at_s - state["time_ns"] / 1e9) > _FRESH_S:
                lacks.append(f"API: {one['id']} is old")
            if state["reason"] in CAMERA_FAULTS:
                lacks.append(f"API: {one['id']} is {state['reason']}")
            if one["gate"]["open"]:
                stable.setdefault(one["id"], []).append("API")
        for cycle in self._get("/v1/cycles?limit=5")["cycles"]:
            seen.cycles.add(cycle["cycle"])
            if cycle["status"] != "failed":
                seen.cycle_began_s = max(seen.cycle_began_s, cycle["started_ns"] / 1e9)
        for vehicle in self._get("/v1/vehicles")["vehicles"]:
            heard_s = seen.heard_s[vehicle["id"]] = (vehicle["heard_ns"] or 0) / 1e9
            if abs(seen.at_s - heard_s) > _HEARD_S:
                lacks.append(f"API: {vehicle['id']} is not heard")
        if seen.cycles:
            latest = self._get(f"/v1/cycles/{max(seen.cycles)}")["report"]
            seen.latest_began_s = latest["started_ns"] / 1e9
            seen.opened = frozenset(g["segment"] for g in latest["gates"] if g["open"])

    def _get(self, path: str) -> dict[str, Any]:
        answer = self._api.call("GET", path, token=self._token, within_s=_WITHIN_S)
        if answer.status != 200:
            detail = answer.document.get("detail", "")
            raise InputError("the API", f"{path}: {answer.status} {detail}", "wait")
        return answer.document


class PageFollower:
    """Follows the operator's page as a browser does: its tables, as they are shown now."""

    def __init__(self, address: str) -> None:
        self.heard_s = 0.0
        self.roads: dict[str, dict[str, Any]] = {}
        self.rsus: dict[str, dict[str, Any]] = {}
        self._address, self._ended = address, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End."""
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                with urllib.request.urlopen(f"{self._address}/api/live", timeout=5.0) as answer:
                    self._read(answer)
            except OSError:
                pass
            # A browser without a page shows that it has none.
            self.roads, self.rsus = {}, {}
            self._ended.wait(0.5)

    def _read(self, answer: Any) -> None:
        kind = ""
        for raw in answer:
            if self._ended.is_set():
                return
            self.heard_s = time.time()
            line = raw.decode().rstrip("\n")
            if line.startswith("event: "):
                kind = line[7:]
            elif line.startswith("data: "):
                self._take(kind, json.loads(line[6:]))

    def _take(self, kind: str, data: dict[str, Any]) -> None:
        if kind == "moment":
            self.roads, self.rsus = data["roads"], data["rsus"]
            return
        for table in ("roads", "rsus"):
            told = data["set"].get(table, {})
            gone = data["del"].get(table, ())
            old = getattr(self, table)
            new = {name: row for name, row in old.items() if name not in gone}
            for name, row in told.items():
                new[name] = {**new.get(name, {}), **row}
            setattr(self, table, new)
