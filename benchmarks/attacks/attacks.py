"""The table of all attacks."""

from benchmarks.attacks.bus_attacks import BUS_ATTACKS, CONTROLS
from benchmarks.attacks.counter_attacks import COUNTER_ATTACKS
from benchmarks.attacks.file_attacks import FILE_ATTACKS
from benchmarks.attacks.memory_attacks import MEMORY_ATTACKS
from benchmarks.attacks.network_attacks import NETWORK_ATTACKS
from benchmarks.attacks.process_attacks import PROCESS_ATTACKS

ATTACKS = (
    *(*CONTROLS, *BUS_ATTACKS, *NETWORK_ATTACKS, *FILE_ATTACKS, *MEMORY_ATTACKS),
    *(*COUNTER_ATTACKS, *PROCESS_ATTACKS),
)
