"""Assertion of error messages."""

import re
from typing import Any

import pytest


def refused(sentence: str, kind: type[Exception]) -> Any:
    """Return a context that expects `kind` with exactly this message."""
    return pytest.raises(kind, match=rf"\A{re.escape(sentence)}\Z")
