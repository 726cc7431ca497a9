"""Independent random streams, one per purpose and actor: a new robot or draw changes no other stream."""

import hashlib
from typing import Final

import numpy as np
from numpy.random import PCG64, Generator, SeedSequence

_WORDS: Final = 4
"""32-bit words per name in the spawn key: 128 bits exclude collisions of names."""


def generator(seed: int, purpose: str, actor: str, epoch: int = 0) -> Generator:
    """Return the random stream of `actor` for `purpose` in a run with `seed` (≥ 0) and boot `epoch`.

    Equal arguments give equal draws on every machine; streams with different arguments are independent
    (numpy.random.SeedSequence, spawn_key).
    """
    key = (*_words(purpose), *_words(actor), epoch)
    return Generator(PCG64(SeedSequence(seed, spawn_key=key)))


def keyed_seed(seed: int, key: str, part: str) -> int:
    """Return the seed (63 bits) of one part of a run with `seed` and `key`, hexadecimal; without key: `seed`.

    Without the key it cannot be computed from `seed` or other parts' seeds (keyed BLAKE2b, RFC 7693).
    """
    if not key:
        return seed
    hashed = hashlib.blake2b(f"{seed} {part}".encode(), key=bytes.fromhex(key), digest_size=8)
    return int.from_bytes(hashed.digest(), "big") >> 1


def derived_seed(seed: int, actor: str, key: str = "") -> int:
    """Return the seed (63 bits) of all of `actor`'s random streams in a run with `seed`.

    It reveals no other actor's seed. Without a key it is only as secret as the run's seed: trying all small
    seeds finds it.
    """
    if key:
        return keyed_seed(seed, key, f"robot {actor}")
    state = SeedSequence(seed, spawn_key=(*_words("seed"), *_words(actor))).generate_state(1, np.uint64)
    return int(state[0]) >> 1


def _words(name: str) -> tuple[int, ...]:
    """Return a hash of the name that is equal in every Python process, unlike `hash`."""
    digest = hashlib.sha256(name.encode()).digest()
    return tuple(int(word) for word in np.frombuffer(digest, "<u4", count=_WORDS))
