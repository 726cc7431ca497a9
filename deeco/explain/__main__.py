"""Entry point of `python -m deeco.explain`."""

import sys

from deeco.explain.command import main

if __name__ == "__main__":
    sys.exit(main())
