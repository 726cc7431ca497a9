"""The actors of a swarm: one world, one radio, one process per robot, and optional observers."""

import hashlib
import os
import re
from pathlib import Path
from typing import Final

_HERE: Final = Path(__file__).parent
_COMPILED: Final = re.compile(r"(?:from|import) numba\b")
_IMPORTED: Final = re.compile(r"(?:from|import) (actors[\w.]*)(?: import (\([^)]*\)|.*))?")


def kernel_sources() -> list[Path]:
    """Every file with kernels, and whatever those import of this package, from one to the next."""
    texts = {source: source.read_text(encoding="utf-8") for source in sorted(_HERE.rglob("*.py"))}
    named = {_module(source): source for source in texts}
    found = dict.fromkeys(source for source, text in texts.items() if _COMPILED.search(text))
    todo = list(found)
    while todo:
        for package, names in _IMPORTED.findall(texts[todo.pop()]):
            for name in (package, *(f"{package}.{one}" for one in re.findall(r"\w+", names))):
                source = named.get(name)
                if source is not None and source not in found:
                    found[source] = None
                    todo.append(source)
    return sorted(found)


def kernel_cache() -> Path:
    """A folder for compiled kernels that belongs to this very state of their sources.

    numba itself looks at a kernel's own file only, not at those of the kernels that it calls and inlines:
    after a change there it would go on with the old code, and a run with an old digest.
    """
    state = hashlib.sha256()
    for source in kernel_sources():
        state.update(source.read_bytes())
    return _HERE / "__pycache__" / f"kernels-{state.hexdigest()[:16]}"


def _module(source: Path) -> str:
    *folders, name = source.relative_to(_HERE.parent).with_suffix("").parts
    return ".".join(folders if name == "__init__" else (*folders, name))


# Read by numba when it is first imported, which no module of this package does before this line.
if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_cache())
