"""Orders to a run in progress: parsing and sending."""

import contextlib
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import msgspec

from actors import orders
from actors.installation.usage import OptionError, wrong_value
from actors.instant import seconds
from actors.message_limits import OrderLimits, order_fault
from actors.messages import ANSWERED, CONTROL, Control, OrderOutcomes
from actors.orders import Order
from actors.runtime.codec import decode, encode
from actors.runtime.core import Bus, at
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials, rules
from actors.runtime.zenoh_bus import open_mesh


def _number_parser(create: Callable[..., Order], count: int) -> Callable[[Sequence[str]], Order]:
    def order(words: Sequence[str]) -> Order:
        values = [float(word) for word in words]
        if len(values) != count:
            raise ValueError
        return create(*values)

    return order


def _robot_parser(create: Callable[[str], Order]) -> Callable[[Sequence[str]], Order]:
    def order(words: Sequence[str]) -> Order:
        (robot,) = words
        return create(robot)

    return order


def _parse_factor(word: str) -> float:
    factor = 0.0 if word == "max" else float(word)
    if factor == 0 and word != "max":
        raise ValueError
    return factor


def _parse_lose(words: Sequence[str]) -> Order:
    robot, sender = words
    return orders.LoseFrame(robot, sender)


def _parse_move(words: Sequence[str]) -> Order:
    robot, *pose = words
    return _number_parser(lambda x, y, heading: orders.Move(robot, x, y, heading), 3)(pose)


def _parse_give(words: Sequence[str]) -> Order:
    robot, *item = words
    if len(item) == 2:
        with contextlib.suppress(ValueError):
            return orders.ItemAssignment(robot, ((float(item[0]), float(item[1])),))
    return orders.ItemAssignment(robot, (msgspec.json.decode(" ".join(item)),))


_VERB_SYNTAX: Final[Mapping[str, tuple[str, Callable[[Sequence[str]], Order]]]] = MappingProxyType({
    "kill": ("ROBOT", _robot_parser(orders.Kill)),
    "freeze": ("ROBOT", _robot_parser(orders.Freeze)),
    "thaw": ("ROBOT", _robot_parser(orders.Thaw)),
    "restart": ("ROBOT", _robot_parser(orders.Restart)),
    "move": ("ROBOT X Y HEADING", _parse_move),
    "jam": ("X Y RADIUS SECONDS", _number_parser(lambda x, y, r, s: orders.StartJam(x, y, r, seconds(s)), 4)),
    "lose": ("ROBOT SENDER", _parse_lose),
    "obstacle": ("X Y RADIUS", _number_parser(orders.Obstacle, 3)),
    "wall": ("X Y TO_X TO_Y", _number_parser(orders.Wall, 4)),
    "give": ("ROBOT X Y|JSON", _parse_give),
    "close": ("X Y", _number_parser(orders.CloseDoor, 2)),
    "open": ("X Y", _number_parser(orders.OpenDoor, 2)),
    "pause": ("", _number_parser(orders.Pause, 0)),
    "resume": ("", _number_parser(orders.Resume, 0)),
    "step": ("[N]", lambda words: orders.Step(int(*words) if words else 1)),
    "speed": ("X|max", lambda words: orders.Speed(_parse_factor(*words))),
    "stop": ("", _number_parser(orders.Stop, 0)),
})  # fmt: skip
"""Arguments and parser of each verb."""
VERBS: Final = tuple(_VERB_SYNTAX)


def syntax() -> str:
    """Return the syntax of all orders."""
    return ", ".join(f"{verb} {words}".strip() for verb, (words, _) in _VERB_SYNTAX.items())


def parse(verb: str, words: Sequence[str]) -> Order:
    """Parse an order. Raises OptionError."""
    if verb not in _VERB_SYNTAX:
        raise wrong_value("VERB", verb, f"one of: {syntax()}")
    arguments, read = _VERB_SYNTAX[verb]
    try:
        order = read(words)
    except (ValueError, TypeError, OverflowError, RecursionError):  # too many words, or infinite seconds
        expected = f"{verb} {arguments}".strip()
        raise wrong_value("VERB", " ".join([verb, *words]), f"like {expected}") from None
    if fault := order_fault(order, OrderLimits()):
        raise OptionError(fault)
    return order


def send(out: Path, order: Order, *, patience_s: float = 10.0) -> str | None:
    """Send an order to the run that writes to `out`; it is executed at the start of the next step.

    Return None if it was carried out, else the reason of its refusal. Raises AcrcError if no run is in
    progress there, or it does not answer within `patience_s`.
    """
    file = out / "world" / credentials.ROUTER_FILE
    if not file.is_file():
        raise AcrcError(f"{out}: no run is in progress here; give the folder of a running zenoh run")
    issued = credentials.read_router_file(file)
    config = rules.client_config(issued.files["operator"], issued.endpoint("operator"))
    ticket = secrets.token_hex(8)
    with open_mesh(config, (at(ANSWERED),), patience_s=5.0) as bus:
        bus.publish(CONTROL.key(), encode(Control(0, (order,), ticket)))
        answer = _await_answer(bus, ticket, time.monotonic() + patience_s)
    if answer is None:
        raise AcrcError(
            f"{out}: the run has not answered within {patience_s:g} s; it executes the order at the start of "
            "its next step, or run.json lists it as refused"
        )
    return "; ".join(answer.refusals) or None


def _await_answer(bus: Bus, ticket: str, deadline: float) -> OrderOutcomes | None:
    topic = at(ANSWERED).topic
    while time.monotonic() < deadline:
        while (delivery := bus.poll(topic)) is not None:
            answer = decode(topic, delivery.key, delivery.payload)
            assert isinstance(answer, OrderOutcomes)
            if answer.ticket == ticket:
                return answer
        time.sleep(0.005)
    return None
