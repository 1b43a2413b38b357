"""A caller that gives and cancels orders all the time, and keeps what it was told."""

from __future__ import annotations

import itertools
import threading
import time
from collections import Counter
from collections.abc import Mapping
from typing import Final, Literal

from slipstream.errors import InputError
from slipstream.http.client import ApiClient
from slipstream.orders import OrderRecord

Told = Literal["taken", "cancelled"]
_PERIOD_S: Final = 0.4
_WITHIN_S: Final = 2.0
_OPEN: Final = 2
"""Orders of ours that are open at once: the vans have enough to do."""
_NODES: Final = ("c1", "c2", "c3", "c4")


class Caller:
    """A context manager. Read `told` after its end, or through `acknowledged`.

    Attributes:
        told: what the API has acknowledged, by order; of one that was not answered nothing is.
        outcomes: numbers of answers by their status, 0: none came.
    """

    def __init__(self, api: str, token: str) -> None:
        self.told: dict[str, Told] = {}
        self.outcomes: Counter[int] = Counter()
        self._api, self._token = ApiClient(api, "the API"), token
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._open: list[str] = []

    def __enter__(self) -> Caller:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        for number in itertools.count(1):
            if self._ended.wait(_PERIOD_S):
                return
            if len(self._open) < _OPEN:
                self._give(f"chaos-{number}", _NODES[number % len(_NODES)])
            else:
                self._cancel(self._open.pop(0))

    def _give(self, order: str, node: str) -> None:
        if self._call("POST", "/v1/orders", {"id": order, "node": node}) in (200, 201):
            self.told[order] = "taken"
            self._open.append(order)

    def _cancel(self, order: str) -> None:
        """A vehicle may have left with it: then it stays an order that was taken."""
        if self._call("DELETE", f"/v1/orders/{order}") == 200:
            self.told[order] = "cancelled"

    def _call(self, method: str, path: str, body: Mapping[str, str] | None = None) -> int:
        began = time.monotonic()
        try:
            status = self._api.call(method, path, body, self._token, _WITHIN_S).status
        except InputError:
            status = 0
            self._ended.wait(max(0.0, _PERIOD_S - (time.monotonic() - began)))
        self.outcomes[status] += 1
        return status


def lost(told: Mapping[str, Told], stored: Mapping[str, OrderRecord]) -> list[str]:
    """What was acknowledged and is not in the store, in words."""
    found = []
    for order, what in sorted(told.items()):
        record = stored.get(order)
        if record is None:
            found.append(f"order {order}: {what}, and not stored")
        elif what == "cancelled" and record.listed:
            # Its state may be another: a vehicle that had its plan may leave with it (docs/fleet).
            found.append(f"order {order}: cancelled, and stored as asked for, {record.state}")
    return found
