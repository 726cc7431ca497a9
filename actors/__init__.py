"""The actors of a swarm: one world, one radio, one process per robot, and optional observers."""

import hashlib
import os
from pathlib import Path


def kernel_cache() -> Path:
    """A folder for compiled kernels that belongs to this very state of the sources.

    numba itself looks at a kernel's own file only, not at those of the kernels that it calls and inlines:
    after a change there it would go on with the old code, and a run with an old digest.
    """
    here = Path(__file__).parent
    state = hashlib.sha256()
    for source in sorted(here.rglob("*.py")):
        state.update(source.read_bytes())
    return here / "__pycache__" / f"kernels-{state.hexdigest()[:16]}"


# Read by numba when it is first imported, which no module of this package does before this line.
if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_cache())
