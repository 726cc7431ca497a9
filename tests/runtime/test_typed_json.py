from typing import Annotated, Literal

import msgspec
import pytest

from actors.runtime import typed_json


class Part(msgspec.Struct, forbid_unknown_fields=True):
    x: int
    share: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    name: Annotated[str, msgspec.Meta(min_length=1)] = "a"
    kind: Literal["a", "b"] = "a"
    counts: dict[str, int] = {}
    maybe: int | None = None


class Whole(msgspec.Struct):
    part: Part
    many: tuple[Part, ...] = ()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{}", "part is missing, but must be there"),
        ('{"part": {"x": "q"}}', 'part.x is "q", but must be a whole number'),
        ('{"part": {"x": 1, "share": 0}}', "part.share is 0, but must be a number above 0"),
        ('{"part": {"x": 1, "share": 2}}', "part.share is 2, but must be a number of at most 1"),
        ('{"part": {"x": 1, "name": ""}}', 'part.name is "", but must be a text of at least length 1'),
        ('{"part": {"x": 1, "kind": "z"}}', 'part.kind is "z"; nothing of the kind may stand there'),
        ('{"part": {"x": 1, "counts": {"q": 0.5}}}', "part.counts[…] is wrong, but must be a whole number"),
        ('{"part": {"x": 1, "maybe": "u"}}', 'part.maybe is "u", but must be a whole number or null'),
        ('{"part": {"x": 1, "y": 1}}', "part.y is not known; leave it out"),
        ('{"part": {"x": 1}, "many": [{"x": 1}, 7]}', "many[1] is 7, but must be an object"),
        ('{"part": {"x": [1}', "part.x is wrong, but must be a whole number"),
        ("[1]", "it is [1], but must be an object"),
        ("{", "Input data was truncated"),
        (b'{"part": {"x": "\xff"}}', "part.x is wrong, but must be a whole number"),
        (b'{"part": {"x": 1, "name": "\xff"}}', "byte 0 is not UTF-8"),
        ('{"y": ' + "[" * 3000 + "]" * 3000 + "}", "it is nested more deeply than what is written here"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_sentence(text: str | bytes, sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        typed_json.decode(text, Whole)
    assert str(caught.value) == sentence
