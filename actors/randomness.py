"""Random streams, one per purpose and actor: another robot or draw changes nothing for the others."""

import hashlib
from typing import Final

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence

_WORDS: Final = 4
"""Words of 32 bits that each name adds to the key; 128 bits keep two names from ever meeting."""


def generator(seed: int, purpose: str, actor: str, epoch: int = 0) -> Generator:
    """The random stream of `actor` for `purpose` in a run of `seed` (≥ 0), anew in each boot `epoch`.

    Equal arguments give equal draws on every machine; streams of different arguments are independent
    (numpy.random.SeedSequence, spawn_key).
    """
    key = (*_words(purpose), *_words(actor), epoch)
    return Generator(PCG64(SeedSequence(seed, spawn_key=key)))


def keyed_seed(seed: int, key: str, part: str) -> int:
    """The seed (63 bits) of one part of a run of `seed` and `key`, hexadecimal digits; "": `seed` itself.

    Without the key it can neither be computed from `seed`, nor from other parts' (BLAKE2b, RFC 7693, keyed).
    """
    if not key:
        return seed
    told = hashlib.blake2b(f"{seed} {part}".encode(), key=bytes.fromhex(key), digest_size=8)
    return int.from_bytes(told.digest(), "big") >> 1


def derived_seed(seed: int, actor: str, key: str = "") -> int:
    """The seed (63 bits) of all that `actor` draws in a run of `seed`; tells nothing of the others'.

    Without a key it is only as secret as the run's seed is hard to guess: whoever tries all small seeds will
    find it.
    """
    if key:
        return keyed_seed(seed, key, f"robot {actor}")
    state = SeedSequence(seed, spawn_key=(*_words("seed"), *_words(actor))).generate_state(1, np.uint64)
    return int(state[0]) >> 1


def _words(name: str) -> tuple[int, ...]:
    """The name as whole numbers that every Python process agrees on, as `hash` would not."""
    digest = hashlib.sha256(name.encode()).digest()
    return tuple(int(word) for word in np.frombuffer(digest, "<u4", count=_WORDS))
