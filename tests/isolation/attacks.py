"""The table of all attacks."""

from tests.isolation.bus_attacks import BUS_ATTACKS, CONTROLS
from tests.isolation.file_attacks import FILE_ATTACKS
from tests.isolation.network_attacks import NETWORK_ATTACKS
from tests.isolation.process_attacks import PROCESS_ATTACKS

ATTACKS = (*CONTROLS, *BUS_ATTACKS, *NETWORK_ATTACKS, *FILE_ATTACKS, *PROCESS_ATTACKS)
