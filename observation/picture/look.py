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


def dark_too(svg: bytes, dark: Mapping[str, str], rules: str = "") -> bytes:
    """A drawing of matplotlib's that follows whether the reader's screen is light or dark.

    `dark`: what colours, as "#22262b", become on a dark one; `rules`: what else holds there, in CSS.
    """
    changed = "".join(
        f'[style*="{key}: {light}"]{{{key}:{other} !important}}'
        for light, other in dark.items()
        for key in ("fill", "stroke")
    )
    screen = f"@media (prefers-color-scheme: dark){{{changed}{rules}}}</style>"
    return svg.replace(b"</style>", screen.encode(), 1)
