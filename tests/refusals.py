"""Refusals in exactly one sentence."""

import re
from typing import Any

import pytest

from actors.runtime.errors import AcrcError


def refused(sentence: str, kind: type[Exception] = AcrcError) -> Any:
    """Return a context whose body must raise `kind` with exactly this text."""
    return pytest.raises(kind, match=rf"\A{re.escape(sentence)}\Z")
