"""What a link makes of a conversation does not depend on how the system cuts the bytes."""

import pytest

from actors.messages import Heard, Sent
from actors.radio.frame import DataFrame
from firmware_bridge.beeclick.reception import Event, UnconfirmedPacket
from firmware_bridge.beeclick.wire import SYNC_PATTERN, Answer, ReceivedPacket, Warmth
from tests.beeclick.hosts import ECHOES, Host, confirm, said

TEXT = b"hello " + SYNC_PATTERN
HELLO = ReceivedPacket(0xBABA, 7, 100, 100, DataFrame(0xBABA, 7, TEXT).check, TEXT)
BOGUS = b"\x01\x70\xba\xba\x07\x00\x8a\xc8\x00\x00"


def conversation(stages: list[list[bytes]]) -> tuple[list[Event], dict[str, int], list[bytes]]:
    """Events, counters and what the board said, each stage in the given pieces."""
    host = Host()
    events: list[Event] = []
    whole: list[bytes] = []

    def stage(*parts: Answer | bytes) -> None:
        data = said(parts)
        whole.append(data)
        number = len(whole) - 1
        pieces = stages[number] if number < len(stages) else [data]
        assert b"".join(pieces) == data
        for piece in pieces:
            events.extend(host.hear(piece))
        host.hear(after=80_000)

    host.due()
    stage(b"\x00\x03Hel", Warmth(215), b"\x02\x01\x00", SYNC_PATTERN, Warmth(216))
    host.due()
    stage(*ECHOES, HELLO)
    numbers = host.send(1, 2, 3, 4)
    stage(confirm(numbers[0]), HELLO, b"\x0b", HELLO)
    host.due()
    half = said([confirm(numbers[1])])
    stage(half[:4], b"\x02" + half[1:5] + b"\x07", half, SYNC_PATTERN[:9], SYNC_PATTERN, Warmth(217))
    host.due()
    stage(*ECHOES)
    numbers = host.send(5, 6)
    events.extend(host.hear(after=1_000_000))
    host.due()
    stage(confirm(numbers[0]), BOGUS, SYNC_PATTERN[:5], confirm(numbers[1]), SYNC_PATTERN)
    host.due()
    stage(*ECHOES, HELLO, Warmth(218))
    return events, dict(host.link.counters), whole


WHOLE = conversation([])
CUTS = [(stage, cut) for stage, data in enumerate(WHOLE[2]) for cut in range(1, len(data))]


def test_the_conversation_is_as_meant() -> None:
    events, counters, _ = WHOLE
    assert [e.tag for e in events if isinstance(e, Sent)] == [1, 2, 5, 6]
    assert [e.tag for e in events if isinstance(e, UnconfirmedPacket)] == [3, 4]
    assert len([e for e in events if isinstance(e, Heard)]) == 3
    assert (counters["ups"], counters["unknown_type"], counters["swallowed_sync"]) == (3, 1, 1)


@pytest.mark.parametrize("stage", range(len(WHOLE[2])))
def test_a_cut_anywhere_changes_nothing(stage: int) -> None:
    data = WHOLE[2]
    for cut in range(1, len(data[stage])):
        pieces = [[one] for one in data]
        pieces[stage] = [data[stage][:cut], data[stage][cut:]]
        assert conversation(pieces)[:2] == WHOLE[:2], cut


def test_byte_by_byte_changes_nothing() -> None:
    pieces = [[data[at : at + 1] for at in range(len(data))] for data in WHOLE[2]]
    assert conversation(pieces)[:2] == WHOLE[:2]
