"""Finds the user's behaviour by its entry string `module:function`."""

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any, cast

from actors.robot.behaviour.modules import is_name
from actors.robot.behaviour.ports import Behaviour, Start
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.failure import failure_note
from deeco import DeecoError


class BehaviourError(AcrcError):
    """A behaviour that cannot be used, or that asks for something impossible."""


def load_behaviour(entry: str, start: Start) -> Behaviour:
    """The behaviour that the function `entry` makes for a robot.

    Raises BehaviourError if there is no such function or if what it gives is no behaviour. An error inside
    of the user's module or function is his own and is passed on.
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
            f"behaviour {entry!r} gives a {type(made).__name__}, which has no method advance(view, until)"
        )
    return cast(Behaviour, made)


def entry_function(entry: str) -> Callable[[Start], Any]:
    """The function that the entry string names."""
    module_name, colon, name = entry.partition(":")
    if not (colon and is_name(module_name) and name):
        raise BehaviourError(
            f"behaviour {entry!r} is no entry; it should look like 'package.module:function'"
        )
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        missing = error.name or module_name
        if module_name != missing and not module_name.startswith(f"{missing}."):
            if _is_installed(missing):
                raise  # the module is there, and imports a part of a package that the package has not
            raise BehaviourError(
                f"behaviour {entry!r}: {module_name} imports {missing!r}, which is not installed; "
                "`acrc add NAME` installs a package for good, by the name that pip knows it by"
            ) from None
        raise BehaviourError(
            f"behaviour {entry!r}: there is no module {missing!r} on Python's path"
        ) from None
    except DeecoError as error:
        raise BehaviourError(f"behaviour {entry!r}: {error}") from error
    except SyntaxError as error:  # the traceback would show the importer's lines, and not one of the user's
        line = (error.text or "").strip()
        raise BehaviourError(
            f"behaviour {entry!r}: {error.filename}:{error.lineno}: {error.msg}{line and f': {line}'}"
        ) from None
    except SystemExit as error:
        raise BehaviourError(f"behaviour {entry!r}: {failure_note('', 0, error).cause}") from None
    function = getattr(module, name, None)
    if function is None:
        raise BehaviourError(f"behaviour {entry!r}: module {module_name!r} has no {name!r}")
    if not callable(function):
        raise BehaviourError(
            f"behaviour {entry!r} is a {type(function).__name__}, but should be a function of a Start"
        )
    return cast(Callable[[Start], Any], function)


def _is_installed(module: str) -> bool:
    return importlib.util.find_spec(module.partition(".")[0]) is not None
