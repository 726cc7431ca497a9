"""`python -m deploy` is the command line."""

import sys

try:
    from deploy.cli.app import main

    main()
except KeyboardInterrupt:  # before `main` minds the signals, or after
    sys.stderr.write("acrc: ended from outside\n")
    sys.exit(130)
