"""`python -m deeco.explain` tells and draws what a component and its ensembles do."""

import sys

from deeco.explain.command import main

if __name__ == "__main__":
    sys.exit(main())
