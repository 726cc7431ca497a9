"""The address of a cluster as a person types it."""

import re
from typing import Final

from actors.runtime.errors import AcrcError
from deploy.usage import wrong_value

_ADDRESS: Final = re.compile(r"dask://(?P<host>[\w.-]+|\[[0-9A-Fa-f:]+\]):(?P<port>[0-9]{1,5})")


class ClusterError(AcrcError):
    """A cluster that is not there, or not of use."""


def tcp(address: str) -> str:
    """The address of the scheduler as its library has it. Raises OptionError for what is none."""
    found = _ADDRESS.fullmatch(address)
    if found is None or not 0 < int(found["port"]) < 65536:
        raise wrong_value("--on", address, "the address of a scheduler, such as dask://192.168.1.5:8786")
    return f"tcp://{found['host']}:{found['port']}"
