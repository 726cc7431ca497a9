"""How often what happened, by name."""

from typing import Final

NAMES: Final = (
    # What became of packets.
    *("sent", "failed", "unconfirmed", "overflowed", "refused", "forgotten"),
    # What was heard, and heard and not passed on, or damaged.
    *("heard", "other_pan", "own_address", "bad_fcs", "fixes", "bad_sentence", "temperatures", "humidities"),
    *("bad_sensor", "infos"),
    # Keeping in step.
    *("answers", "syncs", "ups", "probes", "silent", "lost", "junk_bytes"),
    # Signs of noise: bytes that no board sends, then answers that are missing or that nobody asked for.
    *("unknown_type", "bad_length", "bad_pattern", "bad_status", "bad_channel", "bad_power", "bad_text"),
    *(
        "bad_temperature",
        "swallowed_sync",
        "stalled",
        "no_confirmation",
        "no_echo",
        "echo_skipped",
        "answer_skipped",
    ),
    *("strange_confirmation", "strange_echo", "late_sync", "late_confirmation", "late_echo"),
)
"""All that a link counts, in the order in which it is shown."""


class LinkCounters:
    """The counters of one link."""

    def __init__(self) -> None:
        self._counts = dict.fromkeys(NAMES, 0)

    def __getitem__(self, name: str) -> int:
        return self._counts[name]

    def add(self, name: str, more: int = 1) -> None:
        """Count one more, or several."""
        self._counts[name] += more

    def set(self, name: str, count: int) -> None:
        """Take over a number that is counted elsewhere."""
        assert name in self._counts
        self._counts[name] = count

    def as_dict(self) -> dict[str, int]:
        """All of them."""
        return dict(self._counts)

    def nonzero(self) -> dict[str, int]:
        """Those of what has happened."""
        return {name: count for name, count in self._counts.items() if count}
