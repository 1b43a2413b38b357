"""Orders over the bus: questions with a payload, answers with what the API answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol
from urllib.parse import unquote

from pydantic import Field

from dispatcher_daemon.service.intake.intake import OrderIntake, OrdersRefused
from dispatcher_daemon.service.intake.reading import read_request
from slipstream.bus.answers import Answerer
from slipstream.config import parse_json
from slipstream.errors import InputError
from slipstream.messages import (
    ALL_ORDERS,
    Identifier,
    Message,
    Model,
    OrderRefusal,
    Reason,
    decode,
)
from slipstream.orders import OrderRefused
from storage import StorageError

ACTOR: Final = "bus"
"""Who the log names: the bus's users are its router's, and no message says which one asked."""
_LOGGED: Final = frozenset({"cancel", "pin", "release", "settle"})
_Done = tuple[Message, str | None]
"""The answer, and why its caller says that it was asked for."""


class WhyRequest(Model):
    """Why something is done to an order."""

    reason: Reason | None = Field(default=None, description="In words; null: none.")


class PinRequest(WhyRequest):
    """For which vehicle an order is kept."""

    vehicle: Identifier | None = Field(
        default=None, description="Null: the one whose plan has the order."
    )


class SettleRequest(WhyRequest):
    """What became of an order."""

    served: bool = Field(description="False: it was not served, and is open again.")


class Questioned(Protocol):
    """The part of `slipstream.bus.session.Bus` that is used here."""

    def answer(self, key_expression: str, answerer: Answerer) -> None:
        """Answer questions."""
        ...


class OrderAnswers:
    """Answers to questions on `ALL_ORDERS`.

    Args:
        intake: of the orders.
        note: told of what was done to an order: kind, subject, who did it, which is `ACTOR`, and
            why.
    """

    def __init__(
        self,
        intake: OrderIntake,
        note: Callable[[str, str, str, str | None], None] = lambda kind, subject, actor, why: None,
    ) -> None:
        self._intake, self._note = intake, note

    def listen(self, bus: Questioned) -> None:
        """Answer from now on."""
        bus.answer(ALL_ORDERS, self.answer)

    def answer(self, key: str, payload: bytes) -> tuple[bool, bytes]:
        """(True, receipt or status) or (False, an `OrderRefusal`), as JSON."""
        *_, chunk, action = key.split("/")
        order = unquote(chunk)
        try:
            act = _ACTIONS.get(action)
            if act is None:
                mend = f"ask for one of: {', '.join(_ACTIONS)}"
                raise OrderRefused("invalid", f"unknown action {action!r}", mend, order=order)
            answer, reason = act(self._intake, order, payload)
            if action in _LOGGED:
                self._note(action, f"order/{order}", ACTOR, reason)
            return True, answer.to_bytes()
        except OrderRefused as refused:
            refusal = refused.refusal
        except OrdersRefused as refused:
            refusal = refused.refusals[0]
        except InputError as error:
            refusal = OrderRefusal(
                order=order,
                kind="invalid",
                key=error.key,
                problem=error.problem,
                mend=error.mend,
            )
        except StorageError as error:
            refusal = OrderRefusal(
                order=order,
                kind="unavailable",
                key=None,
                problem=str(error),
                mend="try again later",
            )
        return False, refusal.to_bytes()


def _submit(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    request = read_request(parse_json(payload, "order"))
    if request.id != order:
        mend = "ask on the key of the order"
        raise OrderRefused("invalid", "not the order of its key", mend, order=order, key="id")
    ((receipt, _),) = intake.submit([request])
    return receipt, None


def _cancel(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    reason = _why(payload, "cancel")
    return intake.cancel(order, reason), reason


def _pin(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    pin = decode(PinRequest, payload, "pin") if payload else PinRequest()
    return intake.pin(order, pin.vehicle, pin.reason), pin.reason


def _release(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    reason = _why(payload, "release")
    return intake.release(order, reason), reason


def _settle(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    asked = decode(SettleRequest, payload, "settle")
    return intake.settle(order, served=asked.served, reason=asked.reason), asked.reason


def _why(payload: bytes, action: str) -> str | None:
    return decode(WhyRequest, payload, action).reason if payload else None


_ACTIONS: Final[dict[str, Callable[[OrderIntake, str, bytes], _Done]]] = {
    "submit": _submit,
    "show": lambda intake, order, _: (intake.show(order), None),
    "cancel": _cancel,
    "pin": _pin,
    "release": _release,
    "settle": _settle,
}
