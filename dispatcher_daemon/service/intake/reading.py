"""Plain data as an order request."""

from __future__ import annotations

from collections.abc import Mapping

from slipstream.config import check
from slipstream.errors import InputError
from slipstream.messages import OrderRequest
from slipstream.orders import OrderRefused


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
