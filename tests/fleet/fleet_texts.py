"""Texts of fleet files for tests."""

from pathlib import Path

from actors.runtime.errors import AcrcError
from deploy.fleet.fleet_file import Fleet, parse_fleet
from deploy.fleet.units import UsbPort

ROOT = Path(__file__).parents[2]
OFFICE = ROOT / "fleets" / "office.toml"
KOBUKI_AT_0 = UsbPort("/dev/ttyUSB0", "0403", "6001", "kobuki_A1B2", "1-1.1")
BOARD_AT_1 = UsbPort("/dev/ttyUSB1", "0403", "6001", "A50285BI", "1-1.2")
LIDAR_AT_2 = UsbPort("/dev/ttyUSB2", "10c4", "ea60", "0001", "1-1.3")
HEAD = 'map = "maps/corridor.yaml"\n'
ROBOT = """
[[robot]]
id = "r1"
address = 1
start = [12.0, 5.0, 0.0]
places = [[12.2, 5.9]]
base = "/dev/kobuki"
radio = "/dev/beeclick"
"""


def fleet(text: str = ROBOT, head: str = HEAD, path: Path = ROOT / "some.toml") -> Fleet:
    """Parse a fleet file of `head` (the map's line) and `text`, located beside the maps."""
    return parse_fleet(head + text, path)


def fault(text: str, head: str = HEAD) -> str:
    """Return the error about the text, without the file's name."""
    try:
        parse_fleet(head + text, Path("some.toml"))
    except AcrcError as error:
        return str(error).removeprefix("some.toml: ")
    return "nothing was wrong"


def robot(number: int, more: str = "") -> str:
    """Return a robot's table: ROBOT with lines replaced or added."""
    lines = ROBOT.replace('"r1"', f'"r{number}"').replace("address = 1", f"address = {number}").splitlines()
    keys = {line.partition(" =")[0] for line in more.splitlines()}
    return "\n".join([line for line in lines if line.partition(" =")[0] not in keys] + [more]) + "\n"
