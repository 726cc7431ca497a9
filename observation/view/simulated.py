"""The story of a run in the simulated world."""

from dataclasses import replace
from pathlib import Path

from observation.evidence.run_evidence import EvidenceError
from observation.view.growing_run import GrowingRun
from observation.view.story import Story


def simulated_story(out: Path) -> Story:
    """Read a run's folder, finished, cut or still going on. Raises RecordingError or EvidenceError."""
    with GrowingRun(out) as run:
        story = run.poll(last=True)
        assert story is not None
        if run.step < 0:
            raise EvidenceError(f"{out}: the run ended before its first step")
    if (out / "run.json").is_file():
        return story
    return replace(story, title=f"{story.title}, up to {story.end:g} s: it is going on, or was cut off")
