"""What a board says unasked, as events: packets heard, positions, sensors, its button."""

from typing import Final

from actors.board_readings import Fix, Humidity, Info, Temperature
from actors.instant import Instant
from actors.messages import Heard
from actors.radio.frame_codec import DataFrame
from actors.radio.signal_codes import rssi_dbm
from firmware_bridge.beeclick.answers import Answer, Moisture, Notes, ReceivedPacket, Sentence, Warmth
from firmware_bridge.beeclick.counters import LinkCounters
from firmware_bridge.beeclick.events import Event
from firmware_bridge.beeclick.parameters import BoardSettings
from firmware_bridge.beeclick.sentence import parse

_NO_SENSOR: Final = -397
"""Tenths of a degree, from the number 0: the data line is held low."""
_HOTTEST: Final = 1238
"""Tenths of a degree: the end of the SHT1x's range (Sensirion, data sheet SHT1x); a data line that is held
high gives 615.6 degrees."""
_WETTEST: Final = 1000


def news(
    now: Instant, answer: Answer, settings: BoardSettings, counters: LinkCounters, drop_bad_fcs: bool
) -> list[Event]:
    """The event that an unasked message is; none for what is to be dropped."""
    match answer:
        case ReceivedPacket():
            return _heard(now, answer, settings, counters, drop_bad_fcs)
        case Sentence(text):
            return _fix(now, text, counters)
        case Warmth(tenths):
            valid = _NO_SENSOR < tenths <= _HOTTEST
            counters.add("temperatures" if valid else "bad_sensor")
            return [Temperature(now, tenths / 10, valid)]
        case Moisture(tenths):
            valid = 0 <= tenths <= _WETTEST
            counters.add("humidities" if valid else "bad_sensor")
            return [Humidity(now, tenths / 10, valid)]
        case Notes(text):
            counters.add("infos")
            return [Info(now, text.decode())]
        case _:
            raise AssertionError(answer)


def _heard(
    now: Instant, packet: ReceivedPacket, settings: BoardSettings, counters: LinkCounters, drop_bad_fcs: bool
) -> list[Event]:
    if packet.fcs != DataFrame(packet.pan, packet.address, packet.data).check:
        counters.add("bad_fcs")
        if drop_bad_fcs:
            return []
    if packet.pan != settings.pan:
        counters.add("other_pan")
        return []
    if packet.address == settings.address:
        counters.add("own_address")  # another robot has it, too
    counters.add("heard")
    return [Heard(now, packet.address, rssi_dbm(packet.rssi_code), packet.lqi, packet.data)]


def _fix(now: Instant, text: bytes, counters: LinkCounters) -> list[Event]:
    position = parse(text)
    if position is None:
        counters.add("bad_sentence")
        return []
    counters.add("fixes")
    return [Fix(now, position.valid, position.latitude, position.longitude)]
