"""The command line: what is typed, and what is said."""

import actors  # noqa: F401  # before any other package: it orders sys.path
