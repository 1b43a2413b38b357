"""Arrays of calls, sent to the cluster once and named by their content."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any, Final

from dispatcher_daemon.solvers.cluster.calls import MIN_SHARED_BYTES, name_of

_MAX_KEPT_BYTES: Final = 512_000_000
"""On the cluster; those that were used longest ago go first."""


class SentArrays:
    """What one connection has sent.

    Args:
        client: of `distributed`, asynchronous.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._sent: OrderedDict[str, tuple[Any, int]] = OrderedDict()
        self._kept_bytes = 0

    async def send(self, arrays: Sequence[bytes], workers: Sequence[str]) -> tuple[list[Any], int]:
        """(for each array what stands for it in a call, number of bytes sent).

        Small arrays go with the call. A large one goes to one of the workers; others fetch it from
        there when they get a call with it.
        """
        standing: list[Any] = []
        sent = 0
        for array in arrays:
            if len(array) < MIN_SHARED_BYTES:
                standing.append(array)
                sent += len(array)
                continue
            name = name_of(array)
            known = self._sent.get(name)
            if known is None or known[0].status not in ("finished", "pending"):
                scattered = await self._client.scatter(
                    {name: array}, workers=list(workers), hash=False
                )
                if known is None:
                    self._kept_bytes += len(array)
                known = self._sent[name] = (scattered[name], len(array))
                sent += len(array)
            self._sent.move_to_end(name)
            standing.append(known[0])
        while self._kept_bytes > _MAX_KEPT_BYTES and len(self._sent) > len(standing):
            _, (_, size) = self._sent.popitem(last=False)
            self._kept_bytes -= size
        return standing, sent
