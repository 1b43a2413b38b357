"""The zenoh session that daemons talk over: publish, subscribe, recover.

A daemon connects to a router and listens nowhere. It starts without the router and comes back when
the router does; late subscribers get the last samples from the publishers' caches.
"""

from __future__ import annotations

import contextlib
import random
import socket
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, Self

import zenoh

from slipstream.bus.answers import Answerer, Answers
from slipstream.bus.inbox import Handler, Inbox
from slipstream.bus.routers import endpoints_of, why_unconnected
from slipstream.bus.subscriptions import Listener, Subscription
from slipstream.bus.zenoh_config import client_config, router_config
from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream.messages import ENCODING, Message

KEPT: Final[Mapping[str, int]] = MappingProxyType(
    {"plan": 2, "acknowledgement": 8, "cycle": 8, "counts": 4}
)
"""Messages that a publisher keeps for those whom a router's outage cut off, by the end of its key.

Each answer to a plan, each cycle and each quarter hour's counts is news of its own. Of plans the
one before the last is kept too, which others may wait for. All else, as progress, repeats or
replaces what came before: one.
"""

_ENCODING: Final = zenoh.Encoding(ENCODING)

MAX_EXPECTED: Final = 40_000
_HEARTBEAT_S = 1.0


class Publisher:
    """Publishes on one key."""

    def __init__(self, declared: Any) -> None:
        self._declared = declared

    def put(self, message: Message | bytes) -> None:
        """Publish a message, or raw bytes for pictures; dropped if the link is full for 50 ms."""
        self._declared.put(message if isinstance(message, bytes) else message.to_bytes())

    def has_subscribers(self) -> bool:
        """True if there are subscribers; pictures need not be encoded without them."""
        return bool(self._declared.matching_status.matching)

    def close(self) -> None:
        """Stop publishing on this key."""
        self._declared.undeclare()


class Bus:
    """A zenoh session; open it with `Bus.open`, close it or use it as a context manager.

    Attributes:
        endpoints: of the routers that it connects to.
    """

    def __init__(self, session: Any, endpoints: Sequence[str] = ()) -> None:
        self._session, self.endpoints = session, endpoints
        self._receivers: list[Listener | Subscription] = []
        self._answers: list[Answers] = []
        self._expected: dict[str, Any] = {}

    @classmethod
    def open(cls, settings: BusSettings) -> Self:
        """Open a session. It returns at once, also while no router answers.

        Raises:
            InputError: an endpoint or the configuration file is not understood by zenoh.
        """
        config = client_config(settings)
        return cls(_open_session(config, ", ".join(settings.connect)), endpoints_of(config))

    def publisher(
        self, key: str, *, history: int | None = None, best_effort: bool = False
    ) -> Publisher:
        """Declare a publisher.

        Args:
            key: a concrete key, from `slipstream.messages`.
            history: samples kept for subscribers that come late or were cut off; None: as `KEPT`
                says for the key. 0 for what is published each second anyway: a router needs minutes
                to learn of 10,000 caches.
            best_effort: no cache, no repair, low priority, no schema version: for pictures.
        """
        if best_effort:
            return Publisher(
                self._session.declare_publisher(
                    key,
                    congestion_control=zenoh.CongestionControl.DROP,
                    priority=zenoh.Priority.DATA_LOW,
                    reliability=zenoh.Reliability.BEST_EFFORT,
                )
            )
        if history is None:
            history = KEPT.get(key.rpartition("/")[2], 1)
        if history == 0:
            return Publisher(
                self._session.declare_publisher(
                    key,
                    encoding=_ENCODING,
                    congestion_control=zenoh.CongestionControl.DROP,
                    reliability=zenoh.Reliability.RELIABLE,
                )
            )
        return Publisher(
            zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                encoding=_ENCODING,
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.RELIABLE,
                cache=zenoh.ext.CacheConfig(max_samples=history),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=_HEARTBEAT_S, sporadic_heartbeat=None
                ),
                publisher_detection=True,
            )
        )

    def subscribe(
        self,
        key_expression: str,
        handler: Handler,
        *,
        history: bool = True,
        every: bool = False,
    ) -> None:
        """Call ``handler(key, payload)`` for samples, on a thread of the bus's own.

        zenoh's own threads must not block or call zenoh again; this thread may. What the handler
        raises is logged and survived. What waits for the handler is bounded by `inbox`,
        which also counts what became of each sample.

        Args:
            history: also get what publishers sent before, and repair gaps.
            every: each sample is wanted; otherwise a later one of the same key replaces one that
                still waits.
        """
        samples = Inbox(key_expression, handler, every=every)
        self._receivers.append(
            Subscription(self._session, key_expression, samples, history=history)
        )

    def listener(self, name: str, handler: Handler, *, every: bool = False) -> Listener:
        """One handler, as of `subscribe`, for key expressions that change."""
        listener = Listener(self._session, Inbox(name, handler, every=every, callback=True))
        self._receivers.append(listener)
        return listener

    def expect(self, keys: Iterable[str]) -> None:
        """Have zenoh remember who takes what comes on these keys; else it looks for each sample.

        It compares a sample's key with each other one that it knows of beside it: positions of
        1,000 vehicles with the caches of their 1,000 plans, which takes a fifth of a core.

        Args:
            keys: concrete; beyond `MAX_EXPECTED` the rest is left out.
        """
        for key in keys:
            if key not in self._expected and len(self._expected) < MAX_EXPECTED:
                self._expected[key] = self._session.declare_keyexpr(key)

    def put(self, key: str, message: Message) -> None:
        """Publish once on a key that changes too often to be declared; not cached, not repaired."""
        self._session.put(
            key,
            message.to_bytes(),
            encoding=_ENCODING,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    @property
    def is_connected(self) -> bool:
        """Whether a router or another session answers now."""
        if self._session.is_closed():
            return False
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    def fault(self) -> str | None:
        """Why nothing can be sent or received now; None: it can."""
        return None if self.is_connected else why_unconnected(self.endpoints)

    def answer(self, key_expression: str, answerer: Answerer) -> None:
        """Answer questions, on a thread of the bus's own.

        Args:
            key_expression: of the questions; those that are patterns of keys are refused.
        """
        answers = Answers(key_expression, answerer)
        self._answers.append(answers)
        self._session.declare_queryable(key_expression, answers.accept)

    def ask(self, key: str, payload: bytes, within_s: float) -> tuple[bool, bytes] | None:
        """Ask on a key: (whether it is an answer, or else an error; payload), or None."""
        for reply in self._session.get(key, payload=payload, encoding=_ENCODING, timeout=within_s):
            if reply.ok is not None:
                return True, reply.ok.payload.to_bytes()
            assert reply.err is not None
            text = reply.err.payload.to_bytes()
            return None if text == b"Timeout" else (False, text)
        return None

    def close(self) -> None:
        """Close the session; no handler runs once it has returned."""
        for receiver in self._receivers:
            receiver.close()
        for answers in self._answers:
            answers.close()
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Router:
    """An in-process zenoh router on loopback: for one machine, where no zenohd is wanted.

    Attributes:
        endpoint: the address that clients connect to.
    """

    def __init__(self, port: int = 0) -> None:
        """Start it; port 0 takes a free one.

        Raises:
            InputError: the port is taken.
        """
        self.endpoint = f"tcp/127.0.0.1:{port or free_port()}"
        self._session = _open_session(router_config(self.endpoint), self.endpoint)

    def close(self) -> None:
        """Stop it; clients wait for the next one."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def free_port() -> int:
    """A TCP port on loopback that is free now.

    It is below those that systems give to outgoing connections, one of which could take it before
    the caller does.

    Raises:
        OSError: none of a hundred drawn ones is free.
    """
    for _ in range(100):
        port = random.SystemRandom().randrange(10_000, 32_768)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise OSError("no free port between 10000 and 32767 on 127.0.0.1")


def _open_session(config: Any, where: str) -> Any:
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = str(error).split(" at ")[0]
        raise InputError(
            where, f"zenoh: {reason}", "give a free port or a valid endpoint"
        ) from None
