"""The observer: a window on a run (rerun). It takes no part in the barrier.

It draws what it is given, live or from recordings, into a file and a viewer; `acrc_testbed.view` says what.
"""
