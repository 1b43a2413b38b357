"""Orders over the bus: questions with a payload, answers with what the API answers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar
from urllib.parse import unquote

from dispatcher_daemon.service.intake.intake import OrderIntake, OrdersRefused
from dispatcher_daemon.service.intake.reading import Given, Pin, Settlement, read_request
from slipstream.config import Settings, check, parse_json
from slipstream.errors import InputError
from slipstream.messages import Message, OrderRefusal
from slipstream.orders import OrderRefused
from storage import StorageError

ACTOR: Final = "bus"
"""Who the log names: the bus's users are its router's, and no message says which one asked."""
_LOGGED: Final = frozenset({"cancel", "pin", "release", "settle"})
S = TypeVar("S", bound=Settings)
_Done = tuple[Message, str | None]
"""The answer, and why its caller says that it was asked for."""


class OrderAnswers:
    """Answers to questions on `slipstream.messages.ALL_ORDERS`.

    Args:
        note: told of what was done to an order: kind, subject, who did it, which is `ACTOR`, and
            why.
    """

    def __init__(
        self,
        intake: OrderIntake,
        note: Callable[[str, str, str, str | None], None] = lambda kind, subject, actor, why: None,
    ) -> None:
        self._intake, self._note = intake, note

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


def _pin(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    pin = _read(Pin, payload)
    return intake.pin(order, pin.vehicle, pin.reason), pin.reason


def _plain(
    act: Callable[[OrderIntake, str, str | None], Message],
) -> Callable[[OrderIntake, str, bytes], _Done]:
    """What needs nothing but a reason, if one is given."""

    def done(intake: OrderIntake, order: str, payload: bytes) -> _Done:
        reason = _read(Given, payload).reason
        return act(intake, order, reason), reason

    return done


def _settle(intake: OrderIntake, order: str, payload: bytes) -> _Done:
    asked = _read(Settlement, payload)
    return intake.settle(order, served=asked.served, reason=asked.reason), asked.reason


def _read(model: type[S], payload: bytes) -> S:
    return check(parse_json(payload, "payload") if payload else {}, model, "payload")


_ACTIONS: Final[dict[str, Callable[[OrderIntake, str, bytes], _Done]]] = {
    "submit": _submit,
    "show": lambda intake, order, _: (intake.show(order), None),
    "cancel": _plain(OrderIntake.cancel),
    "pin": _pin,
    "release": _plain(OrderIntake.release),
    "settle": _settle,
}
