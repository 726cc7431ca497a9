"""What the forkserver imports once, so that each process starts in milliseconds and shares the memory."""

import gc

import zenoh  # noqa: F401  # imported, never opened: a fork after a session was open would hang

from actors.runtime import access, isolation, process  # noqa: F401

gc.collect()
gc.freeze()  # so that no collection touches, and so copies, the shared pages
