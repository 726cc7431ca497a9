"""Settings of matplotlib for a while: the user's own have no part in our pictures, nor ours in his."""

import contextlib
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, cast

import matplotlib as mpl


@contextlib.contextmanager
def applied(settings: Mapping[str, Any]) -> Iterator[None]:
    """Pictures are made and written in here, by matplotlib's defaults and these settings of it."""
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font")  # it becomes a box, as anywhere else
        mpl.rcdefaults()
        mpl.rcParams.update(cast(Any, settings))  # its type lists all settings by name
        yield
