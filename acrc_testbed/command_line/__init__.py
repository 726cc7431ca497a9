"""Command line."""

import actors  # noqa: F401  # before any other package: it orders sys.path
