"""What a link passes on of what its board says: packets, measurements, positions, notes."""

import pytest

from actors.board_readings import Fix, Humidity, Info, LinkState, Temperature
from actors.messages import Heard
from firmware_bridge.beeclick.link import LinkPhase
from firmware_bridge.beeclick.parameters import BeeClickParameters
from firmware_bridge.beeclick.wire import Moisture, Notes, ReceivedPacket, Sentence, SetChannel, Warmth
from tests.beeclick.hosts import Host
from tests.beeclick.test_link import packet


def test_a_packet_is_heard_with_its_signal() -> None:
    host = Host().get_ready()
    assert host.hear(packet(b"hello", address=0x0A0B)) == [Heard(host.now, 0x0A0B, -60.0, 200, b"hello")]
    assert host.link.counters["bad_fcs"] == 0


def test_packets_of_other_networks_are_not_passed_on() -> None:
    host = Host().get_ready()
    assert host.hear(packet(b"hello", pan=1)) == []
    assert host.link.counters["other_pan"] == 1


def test_a_packet_from_the_own_address_is_counted() -> None:
    host = Host().get_ready()
    assert len(host.hear(packet(b"hello", address=0x0103))) == 1
    assert host.link.counters["own_address"] == 1


@pytest.mark.parametrize("drop", [False, True])
def test_a_damaged_packet_is_counted_and_dropped_if_wanted(drop: bool) -> None:
    host = Host(BeeClickParameters(drop_bad_fcs=drop)).get_ready()
    damaged = ReceivedPacket(0xBABA, 7, 138, 200, packet(b"hello").fcs, b"hellp")
    assert len(host.hear(damaged)) == (not drop)
    assert host.link.counters["bad_fcs"] == 1


def test_sensors_that_are_missing_are_told_from_those_that_measure() -> None:
    host = Host().get_ready()
    assert host.hear(
        Warmth(-396), Warmth(-397), Warmth(6156), Moisture(0), Moisture(1000), Moisture(-20)
    ) == [
        Temperature(host.now, -39.6, valid=True),
        Temperature(host.now, -39.7, valid=False),
        Temperature(host.now, 615.6, valid=False),
        Humidity(host.now, 0.0, valid=True),
        Humidity(host.now, 100.0, valid=True),
        Humidity(host.now, -2.0, valid=False),
    ]
    assert host.link.counters["bad_sensor"] == 3


def test_a_position_is_passed_on_and_a_damaged_one_is_not() -> None:
    host = Host().get_ready()
    text = b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A"
    (fix,) = host.hear(Sentence(text))
    assert isinstance(fix, Fix)
    assert fix.valid
    assert fix.latitude == pytest.approx(48.1173)
    assert host.hear(Sentence(text.replace(b"4807", b"4808"))) == []
    assert host.link.counters["bad_sentence"] == 1
    assert host.link.phase is LinkPhase.READY


def test_the_boards_notes_are_passed_on() -> None:
    host = Host().get_ready()
    assert host.hear(Notes("txCount: 1\ntemperature: 21 °C\n".encode())) == [
        Info(host.now, "txCount: 1\ntemperature: 21 °C\n")
    ]


def test_a_strange_channel_echo_is_noise() -> None:
    host = Host().get_ready()
    assert host.hear(SetChannel(3)) == [LinkState(host.now, False, "strange_echo")]
