"""Pictures, movies and HTML pages of runs and scenarios, drawn with matplotlib."""

import importlib
import sys
import warnings


def import_matplotlib() -> None:
    """Import matplotlib without 3D axes and generated documentation, which take a third of the time.

    For commands, not for libraries: both remain missing in this process.
    """
    from matplotlib import artist

    vars(artist).update(kwdoc=str)
    sys.modules.setdefault("mpl_toolkits", None)  # type: ignore[arg-type]
    with warnings.catch_warnings(action="ignore"):
        importlib.import_module("matplotlib.figure")
