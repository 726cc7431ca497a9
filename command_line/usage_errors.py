"""What is wrong with the words of a command, said as everywhere: what, with which value; what would be right.

Typer knows these faults, but says them in other forms.
"""

import difflib
import re
from typing import Any, Final, get_args

import typer
from typer._click import exceptions as faults  # typer has no public names for them

from actors.runtime.errors import printable

_NUMBERS: Final = {int: "a whole number", float: "a number"}


def text(error: typer.TyperException) -> str:
    """What is to be said: a sentence, or the help where no command was given."""
    if isinstance(error, faults.NoArgsIsHelpError):
        return error.format_message()
    return f"acrc: {printable(_sentence(error))}"


def _sentence(error: typer.TyperException) -> str:
    context: Any = getattr(error, "ctx", None)
    command = context.command_path if context else "acrc"
    match error:
        case faults.NoSuchOption():
            return _unknown_option(error, command, context)
        case faults.BadOptionUsage():
            return _usage(error)
        case faults.MissingParameter():
            return f"{_name(error)}: is missing; {command} --help says what it is"
        case faults.BadParameter():
            return _value(error)
    return _other(error, command, context)


def _other(error: typer.TyperException, command: str, context: Any) -> str:
    if named := re.match(r"No such command '(.*?)'\.", error.message):
        return _unknown_command(named[1], command, context)
    if named := re.match(r"Got unexpected extra argument\(s\) \((.*)\)", error.message, re.DOTALL):
        form = " ".join(context.get_usage().removeprefix("Usage: ").split())
        return f"{command.removeprefix('acrc ')}: has no use for {named[1]}; must be as in {form}"
    return f"{command.removeprefix('acrc ')}: {error.format_message()}"


def _unknown_option(error: faults.NoSuchOption, command: str, context: Any) -> str:
    near = error.possibilities or []
    right = f"did you mean {near[0]}?" if near else f"{command} --help lists those that there are"
    return f"{error.option_name}: is no option of {command}; {right}"


def _usage(error: faults.BadOptionUsage) -> str:
    if error.message.endswith("does not take a value."):
        return f"{error.option_name}: has a value; must stand alone"
    return f"{error.option_name}: has no value; must be followed by one"


def _unknown_command(name: str, command: str, context: Any) -> str:
    known = context.command.list_commands(context)
    near = difflib.get_close_matches(name, known, n=1)
    right = f"did you mean {near[0]}?" if near else f"must be one of {', '.join(known)}"
    return f"{name}: is no command of {command}; {right}"


def _value(error: faults.BadParameter) -> str:
    cause: Any = error.__cause__
    if error.param is None or cause is None:
        return f"{error.param_hint or 'acrc'}: {error.message}"
    value = cause.errors()[0]["input"]
    return f"{_name(error)}: {value}; must be {_right(error)}"


def _name(error: faults.BadParameter) -> str:
    """The option as it is written, or what stands for the argument in the help."""
    parameter: Any = error.param
    if parameter.param_type_name == "argument":
        return str(parameter.metavar).removesuffix("…")
    return str(max(parameter.opts, key=len))


def _right(error: faults.BadParameter) -> str:
    """What a value must be, by the kind and the bounds that the option declares."""
    kind: Any = error.param.type_descriptor  # type: ignore[union-attr]
    (inner, *_) = (*get_args(kind.annotation), kind.annotation)
    words = _NUMBERS.get(inner)
    if words is None:
        return str(error.message)
    least, most = kind.parameter_info.min, kind.parameter_info.max
    bounds = [f" {word} {bound}" for word, bound in (("from", least), ("to", most)) if bound is not None]
    return f"{words}{''.join(bounds)}"
