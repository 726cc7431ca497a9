"""A robot's recorded senses and frames, and another strategy: where would it have decided otherwise?"""

from dataclasses import replace
from pathlib import Path

from actors.runtime.bus.replay_bus import ReplayError
from observation.replay.record_replay import Onlook, ReplayReport, replay_actor


def replay_otherwise(out: Path, actor: str, behaviour: str, onlook: Onlook) -> ReplayReport:
    """Execute a robot again with another behaviour, an entry string, on its own settings.

    Raises ReplayError at the first message that it would have sent otherwise: from there on it would have
    sensed and heard other things than were recorded.
    """
    if actor in {"world", "radio"}:
        raise ReplayError(f"{actor}: has no strategy; must be a robot")
    return replay_actor(out, actor, replace(onlook, behaviour=behaviour))
