"""Where a Kobuki is plugged in.

The name /dev/kobuki, and bytes passed on every millisecond, come from this line, without its breaks, in
/etc/udev/rules.d/60-kobuki.rules:

    SUBSYSTEM=="tty", ATTRS{idVendor}=="0403", ATTRS{idProduct}=="6001", ATTRS{serial}=="kobuki*",
    GROUP="dialout", MODE="0660", ATTR{device/latency_timer}="1", SYMLINK+="kobuki"
"""

from typing import Final

from firmware_bridge.serial_port import FTDI, PortDevice, SerialPort

KOBUKI: Final = PortDevice(name="Kobuki", symlink="/dev/kobuki", baud=115_200, chip=FTDI)


def open_port(path: str = KOBUKI.symlink, patience: float = 0.005) -> SerialPort:
    """The base's port, 115200 baud; a reading waits up to `patience` s.

    Raises PortError with one sentence that says what would help.
    """
    return SerialPort(path, KOBUKI, patience)
