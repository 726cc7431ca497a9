"""Options of claims and benchmarks: each is for some of them, and refused by all others."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from actors.installation.usage import OptionError

_WORDS: Final = {
    "size": "--bytes",
    "source": "--from",
    "maps": "--map",
    "map_file": "--map",
    "commit": "COMMIT",
    "setting": "--set",
}


def given(
    options: Mapping[str, Any], takers: Mapping[str, Sequence[str]], chosen: Sequence[str]
) -> dict[str, Any]:
    """What was given of the options, by the name of the setting.

    `takers`: which settings each claim or benchmark takes. Raises OptionError for one that none of the
    `chosen` takes.
    """
    named = {name: value for name, value in options.items() if value is not None}
    taken = {setting for name in chosen for setting in takers[name]}
    for name in named:
        if name not in taken:
            others = ", ".join(taker for taker, settings in takers.items() if name in settings)
            word = _WORDS.get(name, f"--{name.replace('_', '-')}")
            wrong = (
                f"is not for {', '.join(chosen)}, but for" if chosen else "must stand beside what it is for:"
            )
            raise OptionError(f"{word}: {wrong} {others}")
    return named
