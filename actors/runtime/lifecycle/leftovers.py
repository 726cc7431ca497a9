"""What a user's code has started and not ended: processes and threads, which no strategy may have.

They would outlive the run, and what they do depends on the machine: no run could be had again.
"""

import threading
from collections.abc import Collection


def fault(strays: bool, at_first: Collection[threading.Thread] | None = None) -> str | None:
    """What is wrong with an actor that leaves processes, or other threads than `at_first`."""
    if strays:
        return f"processes of its own were still running at its end: {_RULE}"
    if at_first is None:
        return None
    names = sorted(thread.name for thread in threading.enumerate() if thread not in at_first)
    shown = ", ".join(names)
    return f"threads of its own were still running at its end ({shown}): {_RULE}" if names else None


_RULE = "a strategy must start neither processes nor threads"
