"""What callers send of orders, over HTTP or the bus."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from slipstream.config import Settings, check
from slipstream.errors import InputError
from slipstream.messages import Identifier, OrderRequest, Reason
from slipstream.orders import OrderRefused


class Given(Settings):
    """Why something is done."""

    reason: Reason | None = Field(default=None, description="In words, for the log; null: none.")


class Pin(Given):
    """For which vehicle an order is kept."""

    vehicle: Identifier | None = Field(
        default=None, description="Null: the one whose plan has the order."
    )


class Settlement(Given):
    """What became of an order."""

    served: bool = Field(description="False: it was not served, and is open again.")


def read_request(data: object) -> OrderRequest:
    """Check data, as JSON gives it.

    Raises:
        OrderRefused: naming the first field that is wrong.
    """
    if not isinstance(data, Mapping):
        raise OrderRefused("invalid", "not an object", "send an order as an object")
    name = data.get("id")
    order = name if isinstance(name, str) else None
    try:
        return check(data, OrderRequest, "order")
    except InputError as error:
        # Only its place is a matter of several fields.
        key = error.key or "node"
        problem = error.problem if error.key is None else f"{key}: {error.problem}"
        raise OrderRefused("invalid", problem, error.mend, order=order, key=key) from None
