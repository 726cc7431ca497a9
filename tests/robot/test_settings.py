"""Validation of settings in code and in files; each fault gives one sentence."""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, field

from actors.instant import Duration, seconds
from actors.runtime.errors import AcrcError
from actors.settings import (
    Count,
    Interval,
    ParameterError,
    Place,
    Positive,
    RuleError,
    Settings,
    Share,
    check_range,
    decode,
    load,
    loads,
    plain,
)


class Wheel(Settings, frozen=True):
    radius: Positive

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.radius == 13:
            raise RuleError("have another radius than 13")


class Cart(Settings, frozen=True, kw_only=True):
    name: str
    length: Positive = 1.0
    count: Count = 1
    share: Share | None = None
    mode: Literal["bold", "shy"] = "bold"
    wait: Interval = seconds(2)
    at: Place | None = None
    span: Annotated[float, Meta(ge=0)] | tuple[float, float] = 0.0
    wheel: tuple[Wheel, ...] = ()
    named: dict[str, Wheel] = field(default_factory=dict)
    ends: Annotated[float, Meta(le=5, extra={"unit": "metres"})] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count > 5 and self.mode == "shy":
            raise self.wrong("count", "at most 5 where mode is shy")


@dataclass(frozen=True)
class Plain:
    lease: Duration = dataclasses.field(default=seconds(1))
    points: tuple[float, ...] = ()
    share: Share = 0.5


FAULTS = {
    "": "name is missing, but must be a string",
    "name = 3": "name is 3, but must be a string",
    "nam = 'x'": "unknown key nam; did you mean name?",
    "length = 0": "length is 0, but must be a number above 0",
    "length = inf": "length is Infinity, but must be a number above 0",
    "length = true": "length is true, but must be a number above 0",
    "count = 1.0": "count is 1.0, but must be a whole number of at least 0",
    "count = 9223372036854775808": "count is 9223372036854775808, but must be a whole number of at least 0",
    "share = 1.5": "share is 1.5, but must be a number from 0 to 1",
    "mode = 'brave'": 'mode is "brave", but must be "bold" or "shy"',
    "wait = -1": "wait is -1, but must be a number of seconds from 0 to 1000000",
    "wait = 1e300": "wait is 1e+300, but must be a number of seconds from 0 to 1000000",
    "at = [1, 'x']": 'at is [1, "x"], but must be a point [x, y] in m, within ±100000',
    "span = [1]": "span is [1], but must be a number of at least 0 or ",
    "ends = 6": "ends is 6, but must be a number of metres, at most 5",
    "wheel = 3": "wheel is 3, but must be written as tables [[wheel]]",
    "wheel = [3]": "wheel[0] is 3, but must be a table [[wheel]]",
    "[[wheel]]\nradius = 1\n[[wheel]]\nradius = -1": "wheel[1].radius is -1, but must be a number above 0",
    "[[wheel]]": "wheel[0].radius is missing, but must be a number above 0",
    "[[wheel]]\nradius = 13": "wheel[0] must have another radius than 13",
    "[[wheel]]\nradius = 1\nx = 1": "unknown key wheel[0].x; known keys of wheel[0]: radius",
    "named = 3": "named is 3, but must be written as tables [named.NAME]",
    "named.left = 3": "named.left is 3, but must be a table [named.left]",
    "[named.left]\nradius = 0": "named.left.radius is 0, but must be a number above 0",
    "mode = 'shy'\ncount = 6": "count is 6, but must be at most 5 where mode is shy",
}


@pytest.mark.parametrize("text", FAULTS)
def test_a_fault_gives_one_sentence(text: str) -> None:
    content = loads(text)
    if text and "nam" not in text.partition(" ")[0].replace("named", ""):
        content["name"] = "x"
    with pytest.raises(AcrcError) as caught:
        decode(Cart, content)
    assert str(caught.value).startswith(FAULTS[text])


def test_a_table_reads_back_as_it_was_written() -> None:
    text = "name = 'x'\nlength = 2\nwait = 0.25\nat = [1, 2]\nspan = [0, 3]\n"
    text += "named.left.radius = 1\nwheel = [{radius = 2}]"
    cart = decode(Cart, loads(text))
    assert (cart.length, cart.wait, cart.at, cart.span) == (2.0, 250_000, (1.0, 2.0), (0.0, 3.0))
    assert (cart.named, cart.wheel) == ({"left": Wheel(1.0)}, (Wheel(2.0),))
    assert decode(Cart, plain(cart) | {"named": {"left": {"radius": 1}}}) == cart
    assert (
        decode(Cart, {"count": 3}, "", cart).count == 3 and decode(Cart, {"count": 3}, "", cart).at == cart.at
    )


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"length": math.nan}, "length is NaN, but must be a number above 0"),
        ({"count": -1}, "count is -1, but must be a whole number of at least 0"),
        ({"share": 2.0}, "share is 2.0, but must be a number from 0 to 1"),
        ({"mode": "brave"}, 'mode is "brave", but must be "bold" or "shy"'),
        ({"wait": -1}, "wait is -1, but must be a number of seconds from 0 to 1000000"),
        ({"count": 6, "mode": "shy"}, "count is 6, but must be at most 5 where mode is shy"),
    ],
)
def test_code_is_checked_like_a_file(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        Cart(name="x", **values)
    assert str(caught.value) == f"Cart.{sentence}" and isinstance(caught.value, ValueError)
    check_range("port", 65535, 1, 65535)
    with pytest.raises(ParameterError, match="port is 0, but must be from 1 to 65535"):
        check_range("port", 0, 1, 65535)


def test_dataclasses_are_decoded_too() -> None:
    assert decode(Plain, {"lease": 0.5, "points": [1, 2]}) == Plain(seconds(0.5), (1.0, 2.0))
    for content, sentence in (
        ({"share": 2}, "t.share is 2, but must be a number from 0 to 1"),
        ({"points": ["x"]}, 't.points is ["x"], but must be a list, each item a finite number'),
        ({"lease": 1e7}, "t.lease is 10000000.0, but must be a number of seconds, at most 1000000"),
    ):
        with pytest.raises(ParameterError) as caught:
            decode(Plain, content, "t")
        assert str(caught.value) == sentence


def test_a_sentence_about_a_file_begins_with_its_name(tmp_path: Path) -> None:
    file = tmp_path / "cart.toml"
    for text, sentence in (
        ("length = 2", "name is missing, but must be a string"),
        ("[x", "invalid TOML: Expected ']' at the end of a table declaration (at end of document)"),
    ):
        file.write_text(text)
        with pytest.raises(AcrcError) as caught:
            load(file, Cart, "cart")
        assert str(caught.value) == f"{file}: {sentence}"
    file.write_text("name = 'x'")
    assert load(file, Cart, "cart") == Cart(name="x")
