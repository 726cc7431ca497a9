"""The radio as a program: `python -m actors.radio --setup FILE --router ENDPOINT …`."""

import os
import sys
from collections.abc import Sequence

from actors.radio.program import parse, part
from actors.runtime.access.rules import client_config
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.parent import answer_where, die_with_parent
from actors.runtime.process import play
from actors.runtime.recording import Recorder


def main(argv: Sequence[str]) -> int:
    """Run the radio; the exit code."""
    answer_where()
    try:
        options = parse(argv)
        if options.client.with_parent:
            die_with_parent(os.getppid())
        config = client_config(options.client.credentials, options.client.router)
        radio, client = part(argv), options.client
        return play(radio, Recorder(client.record, radio.run.step_us), config, patience_s=client.patience_s)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
