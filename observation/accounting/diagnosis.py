"""How well robots' own word that they are blocked agrees with the truth."""

from collections.abc import Mapping
from statistics import median

from observation.accounting.classify import Classified
from observation.accounting.episodes import runs
from observation.accounting.said import Said, seconds_of, spells
from observation.accounting.time_spent import DiagnosisScore
from observation.accounting.tracks import Tracks


def score(tracks: Tracks, said: Mapping[str, Said], classified: Classified) -> DiagnosisScore | None:
    """Over all robots that ask themselves whether they are blocked; None if none does.

    A robot is truly blocked while it stands although it wants to be elsewhere, whatever the cause; a robot
    that waits on purpose is not.
    """
    both = told = true = count = noticed = false_alarms = 0
    delays: list[float] = []
    asked = False
    for index, robot in enumerate(tracks.robots):
        blocked = said.get(robot, Said()).blocked
        if blocked is None:
            continue
        asked = True
        says, is_so = spells(blocked, tracks), classified.stood[:, index]
        both, told, true = both + int((says & is_so).sum()), told + int(says.sum()), true + int(is_so.sum())
        false_alarms += sum(not is_so[begin:end].any() for begin, end in runs(says))
        for begin, end in runs(is_so):
            count += 1
            if says[begin:end].any():
                noticed += 1
                delays.append(seconds_of(tracks, int(says[begin:end].argmax())))
    if not asked:
        return None
    return DiagnosisScore(
        precision=round(both / told, 4) if told else None,
        recall=round(both / true, 4) if true else None,
        delay_s=round(median(delays), 3) if delays else None,
        spells=count,
        noticed=noticed,
        false_alarms=false_alarms,
    )
