"""Emulation of a BEE-click board and its firmware, faults included; without I/O.

Source: d3scomp/beeclickarm, branch robot-additions, TODQueue.cpp and TOHQueue.cpp. Both rings have eight
slots, seven of them usable: the firmware treats a full ring as empty. Not modelled: interrupt races that mix
answers (see `device_lines.LineNoise`). The radio preset models the receiver being off during readout.
"""

import struct
from collections import deque
from collections.abc import Callable
from typing import Final

from actors.instant import Instant, milliseconds, seconds
from actors.messages import FRAME_DATA_LIMIT, FrameSent, RadioEvent
from actors.radio.frame import DataFrame
from firmware_bridge.beeclick.answer_decoder import actual_power
from firmware_bridge.beeclick.board_messages import (
    SEND_PACKET,
    SET_ADDRESS,
    SET_CHANNEL,
    SET_POWER,
    SYNC,
    SYNC_PATTERN,
    Answer,
    BoardInfo,
    GpsSentence,
    HumidityReading,
    PacketConfirmation,
    ReceivedPacket,
    SetAddress,
    SetChannel,
    SetPower,
    SyncAnswer,
    TemperatureReading,
    byte_time,
    bytes_in,
    encode_answer,
)
from firmware_bridge.beeclick.emulated_medium import DeviceMedium

_BYTES_PER_STEP: Final = 9
"""Number of incoming bytes processed at once, about 100 µs."""
_MAX_SENTENCE_BYTES: Final = 254


_TEMPERATURE: Final = 215
"""Tenths of a degree Celsius: room temperature."""
_HUMIDITY: Final = 400
"""Relative humidity, tenths of a percent: that of a room."""
_FIRST_READING: Final = seconds(1.37)
"""Time from start to first temperature: 102 ticks of 10 ms plus a reading (SensorPublisher.cpp,
SHT1x.cpp)."""
_READING: Final = seconds(0.35)
"""Duration of one reading: 27 ms reset, 5 ms command, 320 ms measurement (SHT1x.cpp)."""
_CHANNEL_CHANGE: Final = milliseconds(0.2)
"""Duration of a channel change, during which commands and radio wait: the wait after the reset of the RF
state machine (MRF24J40.cpp)."""
_REST: Final = seconds(1.01)
"""Pause between a humidity and the next reading: 101 ticks."""


class EmulatedBoard:
    """Board. `take`, `run`: serial line; `finish_frame`, `receive_frame`: medium; others: user actions."""

    def __init__(self, radio: DeviceMedium, now: Instant) -> None:
        self._radio = radio
        self.counters = dict.fromkeys(("transmitted", "heard", "lost", "crashes", "reboots"), 0)
        self._start(now)

    def _start(self, now: Instant) -> None:
        self.pan = self.address = self.channel = 0
        """Channel code, 0 to 15."""
        self.power_dbm = -10.0
        self.hung = False
        self.commands = CommandRing()
        self._answers = AnswerRing(now)
        self._incoming: deque[tuple[int, bytes]] = deque()
        self._taken_bytes = 0
        """Number of received bytes of the first delivery."""
        self._line_free_at: int = now
        self._sending = False
        self._fails_at: Instant | None = None
        """Time at which the radio reports failure of a frame that it cannot send."""
        self._sentence = b""
        self._button_until: Instant | None = None
        """End of the processing of the button, during which nothing else runs."""
        self._channel_change: tuple[Instant, int] | None = None
        """End of a channel change, and the requested code."""
        self._deferred: list[Answer | bool] = []
        """Deferred radio events: a received packet, or whether a frame was sent."""
        self._next_reading: tuple[int, bool] = (now + _FIRST_READING, True)

    # --- serial line ----------------------------------------------------------------------------------------

    def take(self, now: Instant, data: bytes) -> None:
        """Accept bytes that the host starts to send now, or after earlier ones."""
        begin = max(now, self._line_free_at)
        self._line_free_at = begin + byte_time(len(data))
        self._incoming.append((begin, data))

    def run(self, now: Instant) -> bytes:
        """Advance to `now`; return the bytes sent to the host since the last call."""
        self.settle(now)
        return b"" if self.hung else self._answers.collect(now)

    def settle(self, now: Instant) -> None:
        """Advance to `now`."""
        self._run_unless_hung(lambda: self._run(now))
        self._answers.settle(now)

    def wake(self) -> Instant | None:
        """Return the time of the next action; None: none, or the board hangs."""
        if self.hung:
            return None
        times = [self._next_reading[0], self._button_until, self._answers.wake()]
        if self._incoming:
            begin, data = self._incoming[0]
            times.append(begin + byte_time(min(len(data), self._taken_bytes + _BYTES_PER_STEP)))
        if not self._busy:
            times.append(self._fails_at)
        if self._channel_change is not None:
            times.append(self._channel_change[0])
        return Instant(min(at for at in times if at is not None))

    # --- user actions ------------------------------------------------------------------------------------

    def reboot(self, now: Instant) -> None:
        """Reset the board: address, channel, power, synchronisation and pending bytes are lost."""
        self._radio.drop_frames(self)
        self.counters["reboots"] += 1
        self._start(now)

    def press(self, now: Instant) -> None:
        """Press the button: the board is busy for two readings, then sends INFO."""
        if self._button_until is None:
            self._button_until = Instant(now + 2 * _READING)

    def gps(self, now: Instant, line: bytes) -> None:
        """Accept a GPS line without its line end; only RMC sentences are passed on."""
        if line.startswith(b"$GPRMC"):
            self._sentence = line[:_MAX_SENTENCE_BYTES]
            self._run_unless_hung(lambda: self._handle_commands(now))

    # --- medium --------------------------------------------------------------------------------------

    def finish_frame(self, now: Instant, end: RadioEvent) -> None:
        """Accept the outcome of the frame being sent."""
        succeeded = isinstance(end, FrameSent)
        if self._busy:
            self._deferred.append(succeeded)
            return
        self._run_unless_hung(lambda: self._handle_radio_event(now, succeeded))

    def receive_frame(self, now: Instant, frame: DataFrame, rssi: int, lqi: int) -> None:
        """Accept a received frame, with RSSI and LQI codes of the chip."""
        packet = ReceivedPacket(frame.pan, frame.source, rssi, lqi, frame.check, frame.data)
        if not self._busy:
            self._run_unless_hung(lambda: self._handle_radio_event(now, packet))
        elif any(isinstance(one, ReceivedPacket) for one in self._deferred):
            self.counters["lost"] += 1  # the chip buffers one
        else:
            self._deferred.append(packet)

    # --- firmware ------------------------------------------------------------------------------------

    def _run_unless_hung(self, action: Callable[[], None]) -> None:
        if self.hung:
            return
        try:
            action()
        except CrashError:
            self.hung = True
            self.counters["crashes"] += 1

    def _run(self, now: Instant) -> None:
        if self._button_until is not None and now >= self._button_until:
            self._button_until = None
            text = (
                f"txCount: {self.counters['transmitted']}\nrxCount: {self.counters['heard']}\n"
                f"panId: {self.pan:04x}\nsAddr: {self.address:04x}\nchannelNo: {self.channel}\n"
                f"mainCycles: 0\ntemperature: {_TEMPERATURE}\nhumidity: {_HUMIDITY}\n"
            )
            self._say(now, BoardInfo(text.encode()))
            self._handle_deferred(now)
        if self._channel_change is not None and now >= self._channel_change[0]:
            code, self._channel_change = self._channel_change[1], None
            self.channel = code & 0x0F
            self._say(now, SetChannel(code))
            self.commands.advance()
            self._handle_deferred(now)
        if self._fails_at is not None and now >= self._fails_at and not self._busy:
            self._fails_at = None
            self._handle_radio_event(now, False)
        self._receive(now)
        at, is_temperature = self._next_reading
        if now >= at:
            self._say(now, TemperatureReading(_TEMPERATURE) if is_temperature else HumidityReading(_HUMIDITY))
            pause = _READING if is_temperature else _REST + _READING
            self._next_reading = (at + pause, not is_temperature)

    @property
    def _busy(self) -> bool:
        """True while the button or a channel change is processed; commands and radio wait."""
        return self._button_until is not None or self._channel_change is not None

    def _handle_deferred(self, now: Instant) -> None:
        """Handle waiting radio events and commands, unless the board is still busy."""
        if self._busy:
            return
        deferred, self._deferred = self._deferred, []
        for one in deferred:
            self._handle_radio_event(now, one)
        self._handle_commands(now)

    def _receive(self, now: Instant) -> None:
        while self._incoming:
            begin, data = self._incoming[0]
            through = bytes_in(now - begin)
            for byte in data[self._taken_bytes : through]:
                if self.commands.take(byte):
                    self._handle_commands(now)
            self._taken_bytes = max(self._taken_bytes, min(through, len(data)))
            if self._taken_bytes < len(data):
                return
            self._incoming.popleft()
            self._taken_bytes = 0

    def _handle_radio_event(self, now: Instant, event: Answer | bool) -> None:
        if not isinstance(event, bool):
            self.counters["heard"] += 1
            self._say(now, event)
            return
        number = int.from_bytes(self.commands.current()[2:6], "little")
        self.counters["transmitted"] += event
        self._say(now, PacketConfirmation(number, not event))
        self.commands.advance()
        self._sending = False
        self._handle_commands(now)

    def _handle_commands(self, now: Instant) -> None:
        """Handle commands in order; a packet being sent blocks those behind it."""
        if self._busy:
            return
        if self._sentence:
            self._say(now, GpsSentence(self._sentence))
            self._sentence = b""
        while self.commands.available:
            command = self.commands.current()
            if command[0] == SEND_PACKET:
                if not self._sending:
                    self._send(now, command)
                return
            if command[0] == SET_CHANNEL:
                self._channel_change = (Instant(now + _CHANNEL_CHANGE), command[1])
                return
            self._execute(now, command)
            self.commands.advance()
            if self._sending:
                return

    def _send(self, now: Instant, command: bytes) -> None:
        self._sending = True
        length = command[1]
        if length > FRAME_DATA_LIMIT:  # the chip's behaviour is unknown
            self._fails_at = now
            return
        self._radio.transmit(self, now, 0, command[6 : 6 + length])

    def _execute(self, now: Instant, command: bytes) -> None:
        if command[0] == SYNC:
            self._say(now, SyncAnswer())
        elif command[0] == SET_POWER:
            (requested,) = struct.unpack_from("<h", command, 1)
            self.power_dbm = actual_power(max(min(requested, 0), -399)) / 10
            self._say(now, SetPower(requested))
        elif command[0] == SET_ADDRESS:
            self.pan, self.address = struct.unpack_from("<HH", command, 1)
            self._say(now, SetAddress(self.pan, self.address))

    def _say(self, now: Instant, answer: Answer) -> None:
        self._answers.put(now, encode_answer(answer))


SLOTS: Final = 8
SLOT_BYTES: Final = 134
"""Size of a command slot: type, length, number, 128 bytes of data."""
_SIZES: Final = {SET_CHANNEL: 2, SET_POWER: 3, SET_ADDRESS: 5}


class CrashError(Exception):
    """Firmware crash; only a reset helps."""


class CommandRing:
    """Ring of commands from the host, filled byte by byte.

    Out of step, the receiver compares bytes with the SYNC pattern; a mismatching byte is dropped without
    being tried as the pattern's first. A command of unknown type puts it out of step. Lengths are not
    checked: a long packet overflows into the next slot.
    """

    def __init__(self) -> None:
        self.in_step = False
        self._memory = bytearray(SLOTS * SLOT_BYTES)
        self._read = self._write = self._at = 0

    @property
    def available(self) -> bool:
        """True if the firmware finds a command in the ring."""
        return self._read != self._write

    def take(self, byte: int) -> bool:
        """Accept one byte; return True if it completes a command. Raises CrashError beyond the last slot."""
        base = self._write * SLOT_BYTES
        if base + self._at >= len(self._memory):
            raise CrashError
        self._memory[base + self._at] = byte
        self._at += 1
        is_complete = self._in_step(base) if self.in_step else self._out_of_step(byte)
        if is_complete:
            self._at = 0
            self._write = (self._write + 1) % SLOTS
        return is_complete

    def current(self) -> bytes:
        """Return the command at the read position, with the bytes behind it."""
        base = self._read * SLOT_BYTES
        return bytes(self._memory[base : base + 6 + 255])

    def advance(self) -> None:
        """Discard the current command."""
        self._read = (self._read + 1) % SLOTS

    def _out_of_step(self, byte: int) -> bool:
        if byte != SYNC_PATTERN[self._at - 1]:
            self._at = 0
            return False
        self.in_step = self._at == len(SYNC_PATTERN)
        return self.in_step

    def _in_step(self, base: int) -> bool:
        kind = self._memory[base]
        if kind == 0:
            self.in_step = False  # the pattern's first byte was received
            return False
        if kind > SET_ADDRESS:
            self._at = 0
            self.in_step = False
            return False
        size = 6 + self._memory[base + 1] if kind == SEND_PACKET else _SIZES[kind]
        return self._at == size


class AnswerRing:
    """Ring of answers to the host, sent byte by byte at the baud rate."""

    def __init__(self, now: Instant) -> None:
        self._queue: deque[bytes] = deque()
        """Unsent bytes of each answer."""
        self._burst_start: int = now
        """Start time of the current burst of bytes."""
        self._burst_bytes = 0
        self._sent_bytes = bytearray()

    def put(self, now: Instant, answer: bytes) -> None:
        """Queue an answer. Raises CrashError if all slots are taken: the firmware hangs in its interrupt."""
        self.settle(now)
        if not self._queue:
            self._burst_start = max(now, self._burst_start + byte_time(self._burst_bytes))
            self._burst_bytes = 0
        self._queue.append(answer)
        if len(self._queue) == SLOTS:
            raise CrashError

    def settle(self, now: Instant) -> None:
        """Send the bytes that are on the line by `now`."""
        through = bytes_in(now - self._burst_start) - self._burst_bytes
        while through > 0 and self._queue:
            answer = self._queue.popleft()
            part, rest = answer[:through], answer[through:]
            self._sent_bytes += part
            through -= len(part)
            self._burst_bytes += len(part)
            if rest:
                self._queue.appendleft(rest)

    def collect(self, now: Instant) -> bytes:
        """Return the bytes sent since the last call."""
        self.settle(now)
        sent_bytes, self._sent_bytes = bytes(self._sent_bytes), bytearray()
        return sent_bytes

    def wake(self) -> Instant | None:
        """Return when the current answer has been sent; None: nothing to send."""
        if not self._queue:
            return None
        return Instant(self._burst_start + byte_time(self._burst_bytes + len(self._queue[0])))
