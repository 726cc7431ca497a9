"""A robot as a program: `python -m actors.robot --id r1 --map FILE … --router ENDPOINT …`.

The same whoever sends it Senses: time arrives in messages.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs a process of one thread

import sys
from collections.abc import Sequence

from actors.robot import program, setup
from actors.runtime.access import client_config
from actors.runtime.errors import AcrcError
from actors.runtime.isolation import Plan, isolate
from actors.runtime.parent import die_with_parent
from actors.runtime.process import play
from actors.runtime.recording import Recorder
from actors.runtime.seat import own_folder


def main(argv: Sequence[str]) -> int:
    """Be one robot until told to halt; the exit code."""
    parent = os.getppid()
    try:
        options = program.parse(argv)
        setup.kernels()  # compiled while the cache can still be written
        program.look_in(options.path)  # while it can be seen; what is on the path stays readable
        recorder = Recorder(options.seat.record, options.setup.step_us)  # in a folder that is closed later
        if options.isolate:
            folder = options.seat.record.resolve().parent
            isolate(
                Plan(
                    own=own_folder(folder),
                    hidden=(folder.parent, *options.hidden),
                    readable=(folder,),
                    descriptors=(1, 2, recorder.fileno()),
                    parent=parent if options.seat.with_parent else None,
                )
            )
        elif options.seat.with_parent:
            die_with_parent(parent)
        config = client_config(options.seat.credentials, options.seat.router)
        return play(program.part(argv), recorder, config)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
