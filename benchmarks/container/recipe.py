"""What a container is built from, and how; read from a Dockerfile or an Apptainer definition."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from actors.runtime.errors import AcrcError


class RecipeError(AcrcError):
    """A recipe that says something else than is understood here."""


class BuildCommand(NamedTuple):
    """A command of the build."""

    script: str
    """For /bin/sh."""
    user: str
    """A name in the container; root where nothing was said."""
    folder: str
    environment: Mapping[str, str]


class ContextCopy(NamedTuple):
    """A file or folder of the clone that comes into the container."""

    source: str
    """Relative to the clone."""
    target: str
    """Absolute."""
    owner: str
    """USER:GROUP; empty: root's."""


@dataclass(frozen=True)
class ContainerRecipe:
    """How a container is built and what it runs."""

    base: str
    """The image that it begins with."""
    steps: tuple[BuildCommand | ContextCopy, ...]
    entry: tuple[str, ...]
    """What is run, with the caller's words behind it."""
    user: str = ""
    """Who runs it; empty: whoever calls."""
    folder: str = "/"
    environment: Mapping[str, str] = field(default_factory=dict)
