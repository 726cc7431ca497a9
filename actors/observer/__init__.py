"""The observer: a window on a run (rerun). It takes no part in the barrier.

A run waits for it before the first step, and at its end for its file; in between one that takes nothing holds
it up by a tenth of a second, and then loses messages.
"""
