"""Program of the radio: `python -m actors.radio SETUP`."""

import os
import sys
from collections.abc import Sequence

from actors.radio.program import actor_process, load_setup
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.rules import client_config
from actors.runtime.linux import die_with_parent, enable_stack_dumps
from actors.runtime.process import run_actor
from actors.runtime.process_setup import setup_parser
from actors.runtime.recording import Recorder


def main(argv: Sequence[str]) -> int:
    """Run the radio; return the exit code."""
    enable_stack_dumps()
    try:
        file = setup_parser("actors.radio", "Simulate the radio medium.").parse_args(argv).setup
        program, folder = load_setup(file), file.parent
        process = program.process
        if process.with_parent:
            die_with_parent(os.getppid())
        config = client_config(folder / process.credentials, process.endpoint(folder))
        radio = actor_process(program.actor, folder, process.commit)
        recorder = Recorder(folder / process.record, radio.run.step_us)
        return run_actor(radio, recorder, config, patience_s=process.patience_s)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
