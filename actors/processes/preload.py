"""Imports and compilation in the forkserver, so that processes start in milliseconds and share memory."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: forking a process with threads is unsafe

import importlib

import actors.radio.__main__
import actors.robot.__main__
import actors.world.__main__  # noqa: F401
from actors.radio.program import KERNELS as RADIO_KERNELS
from actors.robot import assembly as robot_setup
from actors.runtime.process import freeze_heap
from actors.runtime.processor import fingerprints
from actors.world.program import KERNELS

# The shipped strategies, by name: actors do not depend on the model problem. User strategies are not shared.
for strategy in importlib.import_module("cleaning.strategies.registry").STRATEGIES.values():
    importlib.import_module(strategy.partition(":")[0])
robot_setup.kernels()  # loads them once for all robots; world and radio load those that they call
fingerprints((*KERNELS, *RADIO_KERNELS), saved=True)
freeze_heap()  # a garbage collection would copy the shared pages
