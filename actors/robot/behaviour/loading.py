"""Loading of user strategies."""

from collections.abc import Callable
from typing import Any, cast

from actors.robot.behaviour.ports import Behaviour, Start
from actors.runtime.errors import AcrcError
from actors.runtime.failure import failure_note
from actors.user_code import entry_object
from deeco import DeecoError


class BehaviourError(AcrcError):
    """A behaviour that cannot be loaded, or that returned an invalid decision."""


def load_behaviour(entry: str, start: Start) -> Behaviour:
    """Return the behaviour that the function `entry` creates for a robot.

    Raises BehaviourError if the function is missing or does not return a behaviour. Errors raised by the
    user's code are passed on.
    """
    function = entry_function(entry)
    try:
        made = function(start)
    except DeecoError as error:
        raise BehaviourError(f"behaviour {entry!r}: {error}") from error
    except SystemExit as error:
        raise BehaviourError(f"behaviour {entry!r}: {failure_note('', 0, error).cause}") from None
    if not callable(getattr(made, "advance", None)):
        raise BehaviourError(
            f"behaviour {entry!r} returned a {type(made).__name__}, which has no method advance(view, until)"
        )
    return cast(Behaviour, made)


def entry_function(entry: str) -> Callable[[Start], Any]:
    """Return the function of an entry string. Raises BehaviourError."""
    try:
        function = entry_object(entry, "behaviour", BehaviourError, "module:behaviour")
    except DeecoError as error:
        raise BehaviourError(f"behaviour {entry!r}: {error}") from error
    if not callable(function):
        raise BehaviourError(
            f"behaviour {entry!r} is a {type(function).__name__}, but should be a function of a Start"
        )
    return cast(Callable[[Start], Any], function)
