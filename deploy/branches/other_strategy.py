"""A robot's recorded senses and frames, and another strategy: where would it have decided otherwise?"""

from dataclasses import replace
from pathlib import Path

from actors import toml_file
from actors.processes.scratch import scratch_folder
from actors.runtime.bus.replay_bus import ReplayError
from actors.runtime.recording import RecordingError
from deploy.scenario.toml_text import document
from observation.replay.moved_runs import run_of
from observation.replay.record_replay import Onlook, ReplayReport, replay_actor
from observation.replay.run_recordings import recordings


def replay_otherwise(out: Path, actor: str, behaviour: str, onlook: Onlook) -> ReplayReport:
    """Execute a robot again with another behaviour, an entry string, on its own settings.

    Raises ReplayError at the first message that it would have sent otherwise: from there on it would have
    sensed and heard other things than were recorded.
    """
    path = recordings(out).get(actor)
    if path is None:
        raise RecordingError(f"{out}: no recording of {actor!r}; there are {', '.join(recordings(out))}")
    argv = run_of(path).argv
    if "--behaviour" not in argv:
        raise ReplayError(f"{actor}: has no strategy; must be a robot")
    with scratch_folder() as folder:
        adaptation = None
        if "--adaptation" in argv:
            adaptation = folder / "adaptation.toml"
            adaptation.write_text(_without_settings(Path(argv[argv.index("--adaptation") + 1])))
        return replay_actor(out, actor, replace(onlook, behaviour=behaviour, adaptation=adaptation))


def _without_settings(path: Path) -> str:
    """The file without [strategy]: those numbers belong to the strategy that was recorded."""
    content = toml_file.tables(toml_file.read(path, "adaptation", RecordingError), path, RecordingError)
    return document({name: table for name, table in content.items() if name != "strategy"})
