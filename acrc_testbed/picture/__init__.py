"""Pictures, movies and HTML pages of runs and scenarios, drawn with matplotlib."""

import importlib
import sys
import warnings


def import_matplotlib() -> None:
    """Import matplotlib without 3D axes, generated documentation and signatures: two fifths of its time.

    For commands, not for libraries: these remain missing in this process.
    """
    from matplotlib import artist

    vars(artist).update(kwdoc=str)
    artist.Artist._update_set_signature_and_docstring = classmethod(id)  # type: ignore[attr-defined]
    sys.modules.setdefault("mpl_toolkits", None)  # type: ignore[arg-type]
    with warnings.catch_warnings(action="ignore"):
        importlib.import_module("matplotlib.figure")
