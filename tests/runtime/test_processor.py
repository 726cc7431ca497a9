"""Which processor a run was made on, and the alarm where one computes otherwise."""

import platform

import msgspec
import numpy as np
import pytest

from actors.runtime.fingerprint import combined, difference, fingerprints, otherwise, parted
from actors.runtime.processor import Processor, _model_in, processor

EPYC = Processor("x86_64", "AMD EPYC", ("avx2", "fma3"))
CORTEX = Processor("aarch64", "Cortex-A76", ("neon",))


class Kernels:
    def __init__(self, name: str, given: bytes | dict[str, bytes]) -> None:
        self.__name__, self.given = name, given

    def fingerprint(self) -> bytes | dict[str, bytes]:
        return self.given


def test_this_processor_has_a_name_and_features() -> None:
    assert np.__version__  # its features are meant
    here = processor()
    assert here.architecture == platform.machine() and here.features
    assert str(here).startswith(f"{here.architecture} ") and ", ".join(here.features) in str(here)
    assert msgspec.json.decode(msgspec.json.encode(here), type=Processor) == here


@pytest.mark.parametrize(
    ("lines", "model"),
    [
        (["processor : 0", "model name\t: AMD EPYC", "model name\t: another"], "AMD EPYC"),
        (["Hardware : BCM2835", "Model : Raspberry Pi 4 Model B"], "Raspberry Pi 4 Model B"),
        (["CPU implementer\t: 0x41", "CPU part\t: 0xd08"], "implementer 0x41, part 0xd08"),
        (["flags : x"], ""),
    ],
)
def test_the_model_is_what_linux_says(lines: list[str], model: str) -> None:
    assert _model_in(lines) == model


def test_a_module_may_give_its_fingerprint_by_function() -> None:
    prints = fingerprints([Kernels("a.b", b"1"), Kernels("a.c", {"sin": b"1", "cos": b"2"})])
    assert list(prints) == ["a.b", "a.c.sin", "a.c.cos"]
    assert prints["a.b"] == prints["a.c.sin"] != prints["a.c.cos"]
    assert combined(prints) == combined(dict(reversed(prints.items())))
    assert parted(combined(prints)) == {name: value[:16] for name, value in prints.items()}


def test_what_computes_otherwise_is_found_among_what_both_have() -> None:
    assert otherwise({"a": "1", "b": "2", "c": "3"}, {"b": "2", "c": "4", "d": "5"}) == ["c"]


@pytest.mark.parametrize(
    ("there", "names", "sentence"),
    [
        (EPYC, [], ""),
        (Processor(""), [], ""),
        (
            CORTEX,
            ["a.sin"],
            "recorded on another processor: other bits come from a.sin; it was aarch64 (Cortex-A76) with "
            "neon, this is x86_64 (AMD EPYC) with avx2, fma3",
        ),
        (
            CORTEX,
            list("abcde"),
            "recorded on another processor: other bits come from a, b, c and 2 more; it was aarch64 "
            "(Cortex-A76) with neon, this is x86_64 (AMD EPYC) with avx2, fma3",
        ),
        (EPYC, ["a.sin"], "recorded with another version of this software: other bits come from a.sin"),
        (
            CORTEX,
            [],
            "recorded on another processor, aarch64 (Cortex-A76) with neon; "
            "this is x86_64 (AMD EPYC) with avx2, fma3, and its functions give the same bits",
        ),
    ],
)
def test_the_cause_of_other_bits_in_words(there: Processor, names: list[str], sentence: str) -> None:
    assert difference(there, EPYC, names) == sentence
