"""The world as a program: `python -m actors.world --setup FILE --router FILE --record FILE`."""

import os
import signal
import sys
from collections.abc import Sequence

from actors.runtime.access import router_file
from actors.runtime.access.credentials import reveal
from actors.runtime.access.rules import router_config
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.parent import answer_where, die_with_parent, leave_in_order
from actors.runtime.process import play
from actors.runtime.recording import Recorder
from actors.world.program import Conductor, build, load_setup, parse, part, world_note


def main(argv: Sequence[str]) -> int:
    """Conduct a run; the exit code."""
    leave_in_order()
    answer_where()
    try:
        options = parse(argv)
        if options.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        setup = load_setup(options.setup)
        core = build(setup)
        conductor = Conductor(core, options.speed)
        note = world_note(setup, argv, options.commit)
        issued = router_file.read(options.router)
        world = part(core, note, conductor.drive, options.spans)
        recorder = Recorder(options.record, setup.step_us)
        try:
            return play(world, recorder, router_config(issued), lambda: reveal(issued))
        finally:
            router_file.remove(options.router)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
