"""Entry point of `python -m acrc_testbed.command_line`."""

import sys

try:
    from acrc_testbed.command_line.app import main

    main()
except KeyboardInterrupt:  # outside the signal handling of `main`
    sys.stderr.write("acrc: interrupted\n")
    sys.exit(130)
