"""`python -m acrc_testbed.command_line` is the command line."""

import sys

try:
    from acrc_testbed.command_line.app import main

    main()
except KeyboardInterrupt:  # before `main` minds the signals, or after
    sys.stderr.write("acrc: ended from outside\n")
    sys.exit(130)
