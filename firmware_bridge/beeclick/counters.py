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


class LinkCounters(dict[str, int]):
    """The counters of one link, by name."""

    def __init__(self) -> None:
        super().__init__(dict.fromkeys(NAMES, 0))

    def add(self, name: str, more: int = 1) -> None:
        """Count one more, or several, of a name that there is."""
        self[name] += more
