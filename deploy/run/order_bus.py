"""Orders to a run in progress: parsing and sending."""

import contextlib
import secrets
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, get_args

import msgspec

from actors import orders
from actors.installation.usage import OptionError, wrong_value
from actors.instant import seconds
from actors.message_limits import OrderLimits, order_fault
from actors.messages import ANSWERED, CONTROL, Control
from actors.orders import Order
from actors.runtime.codec import arrived, encode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials, rules
from actors.runtime.zenoh_bus import open_mesh


def _parse_factor(word: str) -> float:
    factor = 0.0 if word == "max" else float(word)
    if factor == 0 and word != "max":
        raise ValueError
    return factor


def _parse_give(robot: str, *item: str) -> Order:
    if len(item) == 2:
        with contextlib.suppress(ValueError):
            return orders.ItemAssignment(robot, ((float(item[0]), float(item[1])),))
    return orders.ItemAssignment(robot, (msgspec.json.decode(" ".join(item)),))


_NAMES: Final = ("ROBOT", "SENDER")
"""Arguments that name a robot."""
_VERB_SYNTAX: Final[Mapping[str, tuple[str, Callable[..., Order]]]] = MappingProxyType({
    **{one.__struct_config__.tag: (" ".join(one.__struct_fields__).upper(), one) for one in get_args(Order)},
    "jam": ("X Y RADIUS SECONDS", lambda x, y, radius, s: orders.StartJam(x, y, radius, seconds(s))),
    "give": ("ROBOT X Y|JSON", _parse_give),
    "step": ("[N]", lambda steps=1: orders.Step(int(steps))),
    "speed": ("X|max", lambda factor: orders.Speed(_parse_factor(factor))),
})  # fmt: skip
"""Arguments of each verb, usually the order's fields, and a function that returns the order."""
VERBS: Final = tuple(_VERB_SYNTAX)
_PATIENCE_S: Final = 10.0
"""Timeout for the answer of a run, s."""


def syntax() -> str:
    """Return the syntax of all orders."""
    return ", ".join(f"{verb} {words}".strip() for verb, (words, _) in _VERB_SYNTAX.items())


def parse(verb: str, words: Sequence[str]) -> Order:
    """Parse an order. Raises OptionError."""
    if verb not in _VERB_SYNTAX:
        raise wrong_value("VERB", verb, f"one of: {syntax()}")
    arguments, create = _VERB_SYNTAX[verb]
    try:
        order = create(*_values(arguments.split(), words))
    except (ValueError, TypeError, OverflowError, RecursionError):  # too many words, or infinite seconds
        expected = f"{verb} {arguments}".strip()
        raise wrong_value("VERB", " ".join([verb, *words]), f"like {expected}") from None
    if fault := order_fault(order, OrderLimits()):
        raise OptionError(fault)
    return order


def _values(arguments: Sequence[str], words: Sequence[str]) -> Iterable[str | float]:
    """Return the words of an order, with numbers parsed. Raises ValueError."""
    if any(not set("[|").isdisjoint(argument) for argument in arguments):
        return words  # optional or alternative arguments
    pairs = zip(arguments, words, strict=True)
    return [word if argument in _NAMES else float(word) for argument, word in pairs]


def send(out: Path, order: Order) -> str | None:
    """Send an order to the run that writes to `out`; it is executed at the start of the next step.

    Return None if it was carried out, else the reason of its refusal. Raises AcrcError if no run is in
    progress there, or it does not answer within `_PATIENCE_S`.
    """
    file = out / "world" / credentials.ROUTER_FILE
    if not file.is_file():
        raise AcrcError(f"{out}: no run is in progress here; give the folder of a running zenoh run")
    issued = credentials.read_router_file(file)
    config = rules.client_config(issued.files["operator"], issued.endpoint("operator"))
    ticket = secrets.token_hex(8)
    with open_mesh(config, (at(ANSWERED),), patience_s=5.0) as bus:
        bus.publish(CONTROL.key(), encode(Control(0, (order,), ticket)))
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            for answer in arrived(bus, ANSWERED):
                if answer.ticket == ticket:
                    return "; ".join(answer.refusals) or None
            time.sleep(0.005)
    raise AcrcError(
        f"{out}: the run has not answered within {_PATIENCE_S:g} s; it executes the order at the start of "
        "its next step, or run.json lists it as refused"
    )
