"""Program of the world: `python -m actors.world SETUP`."""

import os
import signal
import sys
from collections.abc import Sequence

from actors.runtime.errors import AcrcError
from actors.runtime.isolation import credentials
from actors.runtime.isolation.credentials import publish_sockets
from actors.runtime.isolation.tls import world_config
from actors.runtime.linux import die_with_parent, enable_stack_dumps, exit_on_sigterm
from actors.runtime.process import run_actor
from actors.runtime.process_setup import setup_parser
from actors.runtime.recording import Recorder
from actors.user_code import set_task_folders
from actors.world.program import Conductor, actor_process, build, load_setup, world_note


def main(argv: Sequence[str]) -> int:
    """Conduct a run; return the exit code."""
    exit_on_sigterm()
    enable_stack_dumps()
    try:
        file = setup_parser("actors.world", "Conduct a run.").parse_args(argv).setup
        program, folder = load_setup(file), file.parent
        process = program.process
        if process.with_parent:
            die_with_parent(os.getppid(), signal.SIGTERM)
        set_task_folders([folder / path for path in process.modules])
        core = build(program.actor.resolve_paths(folder))
        conductor = Conductor(core, process.speed)
        note = world_note(program.actor, process.commit)
        router = folder / process.router
        issued = credentials.read_router_file(router)
        world = actor_process(core, note, conductor.drive)
        recorder = Recorder(folder / process.record, program.actor.step_us)
        try:
            return run_actor(world, recorder, world_config(issued), lambda: publish_sockets(issued))
        finally:
            credentials.remove_router_file(router)
    except AcrcError as error:
        sys.stderr.write(f"{error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
