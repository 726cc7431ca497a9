"""Imports and compilation in the forkserver, so that processes start in milliseconds and share memory."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: forking a process with threads is unsafe

import gc

import actors.radio.__main__
import actors.robot.__main__
import actors.world.__main__  # noqa: F401
from actors.radio.program import KERNELS as RADIO_KERNELS
from actors.robot import assembly as robot_setup
from actors.runtime.processor import fingerprints
from actors.world.program import KERNELS

robot_setup.kernels()  # loads them once for all robots; world and radio load those that they call
fingerprints((*KERNELS, *RADIO_KERNELS), saved=True)
gc.freeze()  # a garbage collection would copy the shared pages; imports leave hardly any garbage
