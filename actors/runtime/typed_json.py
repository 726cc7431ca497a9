"""Decoding of untrusted JSON into typed values, with errors of one sentence."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import msgspec

from actors.runtime import regular_file
from actors.runtime.errors import AcrcError
from actors.wording import toml_text

T = TypeVar("T")
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 53)]
"""A count; also an instant or a duration, µs."""
Metres = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Name = Annotated[str, msgspec.Meta(max_length=200)]
Text = Annotated[str, msgspec.Meta(max_length=20_000)]
BoundedList = Annotated[list[T], msgspec.Meta(max_length=10_000)]
"""A list in a report; lists written by robots are limited to a tenth of it."""
Counts = Annotated[dict[Name, Count], msgspec.Meta(max_length=500)]
"""Counts by name."""
_MAX_ERROR: Final = 300
"""Most characters of an error about a file."""
_KINDS: Final = {
    "int": "a whole number",
    "float": "a number",
    "str": "a string",
    "bool": "true or false",
    "object": "an object",
    "array": "a list",
    "null": "null",
}
_BOUNDS: Final = (
    (" of length >= ", " of at least length "),
    (" of length <= ", " of at most length "),
    (" >= ", " of at least "),
    (" <= ", " of at most "),
    (" > ", " above "),
    (" < ", " below "),
    (" that's ", " that is "),
    (" matching regex ", " of the form "),
)
"""Bounds in msgspec's words, and in these errors."""
_EXPECTED: Final = re.compile(r"Expected `(?P<kinds>[^`]+)`(?P<bound>.*?)(?:, got .*)?", re.DOTALL)
_FIELD: Final = re.compile(
    r"Object (?P<how>missing required|contains unknown) field `(?P<name>.*)`", re.DOTALL
)
_STEP: Final = re.compile(r"\.(?P<key>[^.\[]+)|\[(?P<index>\d+)\]")


def dump(value: object) -> bytes:
    """Return a value as indented JSON with a final newline."""
    return msgspec.json.format(msgspec.json.encode(value)) + b"\n"


def read(
    path: Path,
    kind: type[T],
    what: str,
    most: int = regular_file.LARGEST,
    hook: Callable[[type, Any], Any] | None = None,
) -> T:
    """Read a file that should contain a `what`, such as "set-up of a robot". Raises AcrcError."""
    try:
        return decode(regular_file.read_bytes(path, most), kind, hook=hook)
    except OSError as error:
        raise AcrcError(f"{path}: the {what} cannot be read: {error.strerror or error}") from None
    except (ValueError, AcrcError) as error:
        raise AcrcError(f"{path}: invalid {what}: {str(error)[:_MAX_ERROR]}") from None


def decode(
    data: bytes | str | msgspec.Raw,
    kind: type[T],
    *,
    form: Any = msgspec.json,
    hook: Callable[[type, Any], Any] | None = None,
) -> T:
    """Decode `data`: JSON, or the format of the msgspec module `form`.

    Raises ValueError with the fault, its place, the value found and the valid values.
    """
    try:
        found: T = form.decode(data, type=kind, dec_hook=hook)
        return found
    except msgspec.ValidationError as error:
        raise ValueError(_rephrased(str(error), data, form)) from None
    except UnicodeDecodeError as error:
        raise ValueError(f"byte {error.start} is not UTF-8") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def must_be(reason: str) -> str:
    """Return the valid values in `reason`, msgspec's message, as text after "must be"; "" if not stated."""
    expected = _EXPECTED.fullmatch(reason)
    if expected is None:
        return ""
    bound = expected["bound"]
    for theirs, ours in _BOUNDS:
        if bound.startswith(theirs):
            bound = ours + bound.removeprefix(theirs)
            break
    return " or ".join(
        _KINDS.get(kind, kind) for kind in expected["kinds"].split(" | ")
    ) + bound.removesuffix(".0")


def _rephrased(message: str, data: Any, form: Any) -> str:
    """Rephrase an error of msgspec."""
    reason, _, place = message.partition(" - at `")
    of_key = place.startswith("key` in `")
    path = place.removeprefix("key` in `").removeprefix("$").rstrip("`")
    key = path.lstrip(".").replace("[...]", "[…]")
    if field := _FIELD.fullmatch(reason):
        name = f"{key}.{field['name']}" if key else field["name"]
        missing = field["how"].startswith("missing")
        return f"{name} is missing" if missing else f"unknown key {name}; remove it"
    valid = must_be(reason)
    if not valid and not reason.startswith("Invalid"):  # raised by a type of this project
        return f"{key}: {reason}" if key else reason
    name = f"a key of {key}" if of_key else key or "it"
    try:
        actual = "wrong" if of_key or "[...]" in path else toml_text(_value_at(data, path, form))
    except (ValueError, RecursionError):  # the data is invalid elsewhere, too
        actual = "wrong"
    return (
        f"{name} is {actual}, but must be {valid}"
        if valid
        else f"{name} is {actual}, which is not valid here"
    )


def _value_at(data: Any, path: str, form: Any) -> object:
    value = form.decode(data)
    for step in _STEP.finditer(path):
        value = value[step["key"]] if step["key"] else value[int(step["index"])]
    return value
