"""Settings of a board and parameters of the link to it."""

from typing import Annotated, Final

from msgspec import Meta

from actors.instant import Duration, milliseconds, seconds
from actors.settings import ParameterError, Settings
from firmware_bridge.beeclick.wire import LONGEST_COMMAND, SetAddress, SetChannel, SetPower, Setting

POWERS: Final = "0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, which is what the firmware can set"
"""Which there are, in words that go on after "must be"."""
_LARGE_STEP: Final = 100
"""Tenths of a dB (DS39776C, register RFCON3)."""


def radiated(asked: int) -> int:
    """The transmit power, tenths of a dBm, that the firmware sets when asked for `asked`, 0 to -363.

    Whole tens of dB are right. Of the small steps -0.5 to -6.3 dB a mistake of units leaves two: a remainder
    of -0.5 or -0.6 dB gives -0.5, everything from -0.7 on gives -6.3 (MRF24J40.cpp, setTxPower).
    """
    large, rest = divmod(-asked, _LARGE_STEP)
    small = 0 if rest < 5 else 5 if rest < 7 else 63
    return -(large * _LARGE_STEP + small)


def power_setting(power_dbm: float) -> int:
    """What to ask the board for, tenths of a dBm, so that it sends with `power_dbm`. Raises ParameterError.

    A power that the firmware would make another one of is refused.
    """
    asked = round(power_dbm * 10)
    if abs(asked - power_dbm * 10) < 1e-6 and -363 <= asked <= 0 and radiated(asked) == asked:
        return asked
    raise ParameterError("board.power_dbm", power_dbm, POWERS)


FIRST_CHANNEL: Final = 11
"""The channel whose code is 0."""
_LAST_CHANNEL: Final = 26
_Time = Annotated[Duration, Meta(ge=1, le=2**40)]
_Number = Annotated[int, Meta(ge=1, le=10_000)]


class BoardSettings(Settings, frozen=True):
    """How a board is set up. Raises ParameterError for what it cannot be."""

    address: Annotated[int, Meta(ge=0, le=0xFFFD)]
    """Short address of the robot's transceiver, 0 to 0xFFFD; each robot needs its own."""
    channel: Annotated[int, Meta(ge=FIRST_CHANNEL, le=_LAST_CHANNEL)] = 26
    """Of IEEE 802.15.4 in the 2.4 GHz band, 11 to 26. Default: the one that Wi-Fi leaves alone most."""
    pan: Annotated[int, Meta(ge=0, le=0xFFFE)] = 0xBABA
    """PAN id, 0 to 0xFFFE; frames of others are not passed on. Default: that of the original robots
    (d3scomp/beeclickarmROS)."""
    power_dbm: float = -10.0
    """Transmit power, dBm. Default: what the firmware sets at its start (MRF24J40.cpp: RFCON3 = 0x40)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        power_setting(self.power_dbm)

    def commands(self) -> tuple[Setting, ...]:
        """What the board is to be told; the address first, with which it can be asked whether it listens."""
        return (
            SetAddress(self.pan, self.address),
            SetChannel(self.channel - FIRST_CHANNEL),
            SetPower(power_setting(self.power_dbm)),
        )


class BeeClickParameters(Settings, frozen=True):
    """Time-outs and bounds of the link to a board."""

    in_flight: Annotated[int, Meta(ge=1, le=6)] = 4
    """Packets that the board has and has not confirmed. Default: as the original host library
    (AbstractComm.java); with nine the firmware confirms one that never left."""
    transmit_queue: Annotated[int, Meta(ge=0, le=10_000)] = 7
    """Packets that may wait behind the one in the air, on the board and here. Default: as in the simulated
    radio (actors.radio.medium.state)."""
    answer_timeout: _Time = seconds(1.0)
    """For an echo or a confirmation, µs. Default: the board's button holds everything up for 0.70 s, and four
    packets take 0.17 s where every one finds the channel busy to the last try."""
    doubt: _Time = milliseconds(250)
    """After so long without an answer a SYNC is sent behind what was asked, µs; no more packets until it is
    answered. Default: own choice, above the 0.17 s of four packets in a busy channel."""
    ring: int = 6
    """Commands that a board may have and not have answered, packets and SYNCs included. Default: its ring has
    room for seven, but seven answers behind the button's notes would fill that of the answers and hang it."""
    sync_interval: _Time = milliseconds(80)
    """Between two SYNCs while bytes come, µs. Default: noise over, one comes within 100 ms; an answer that
    waits behind four packets, 22 ms, is there before the next."""
    quick_syncs: _Number = 4
    """So many SYNCs are sent at that interval though no byte comes. Default: a board that its button holds up
    gets five in 0.70 s; at the seventh it would hang, its answers filling their ring."""
    slow_sync_interval: _Time = milliseconds(800)
    """Between the SYNCs after them, µs. Default: a little longer than the button holds a board up."""
    noisy_sync_interval: _Time = milliseconds(320)
    """Between SYNCs once the ring may be full and noise comes, µs. Default: own choice; three in a second."""
    deaf_sync_interval: _Time = seconds(10.0)
    """Between SYNCs to a board whose ring is full and that talks all the same, µs. Default: own choice; one
    that was reset is found within that, and the ring of one that is wedged runs over once in a minute."""
    give_up: _Time = seconds(1.0)
    """A board that has answered no SYNC for so long counts as silent, and what it has as unknown, µs.
    Default: as answer_timeout."""
    probe_interval: _Time = milliseconds(250)
    """After so long without an answer the board is asked whether it still listens, µs. Default: own choice; a
    board that has restarted, or lost bytes, is set up again within that and `doubt`."""
    stall: _Time = milliseconds(50)
    """A message that stops in its middle for so long never goes on, µs. Default: own choice, above the 16 ms
    for which USB adapters keep bytes back."""
    filler: _Number = LONGEST_COMMAND
    """Bytes that are no command, ahead of each SYNC. Default: as many as end whatever command the board
    believes to be in; 2.8 ms on the line."""
    drop_bad_fcs: bool = True
    """Drop packets whose frame check sequence does not hold any more when they arrive here, and count them.
    Default: the line has damaged them. That the sequence is handed on right is taken from the firmware's
    source, not from a board; if `bad_fcs` counts every packet of a real one, this must be False."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.in_flight < self.ring <= 7:
            raise self.wrong("ring", f"from {self.in_flight + 1} to 7")


DEFAULTS: Final = BeeClickParameters()
"""Of a link that is given no others."""
