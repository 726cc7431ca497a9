"""What the configurations of all Zenoh sessions have in common."""

from dataclasses import dataclass

import msgspec
import zenoh


@dataclass(frozen=True)
class SessionParameters:
    """When a link counts as dead."""

    lease_s: float = 86_400.0
    """Silence after which the other end closes the link, s. Own choice: a day, for on one machine the end of
    a process closes its sockets, and silence means that it, or the machine, was stopped and may go on."""
    lease_over_network_s: float = 10.0
    """The same where the other end may be out of reach; Zenoh's default."""
    onlooker_s: float = 0.1
    """How long a message may wait for an observer that takes nothing, s; then its link is closed; it connects
    anew once it goes on. Own choice: a run is held up once, for the blink of an eye."""


def session_config(mode: str, lease_s: float = SessionParameters.lease_s) -> zenoh.Config:
    """A `router` or a `client` that looks for nobody, stamps nothing and shares no memory."""
    config = zenoh.Config()
    set_value(config, "mode", mode)
    set_value(config, "scouting/multicast/enabled", False)
    # Gossip would tell clients of each other, and they would connect past the rules.
    set_value(config, "scouting/gossip/enabled", False)
    # Stamps would be the wall clock's, in recordings that have to be equal run for run.
    set_value(config, "timestamping/enabled", False)
    set_value(config, "transport/shared_memory/enabled", False)
    # Messages go out on the thread that sends them: two context switches fewer per step and robot. One
    # priority is enough, for the barrier has at most a handful of messages on a link.
    set_value(config, "transport/unicast/lowlatency", True)
    set_value(config, "transport/unicast/qos/enabled", False)
    set_value(config, "transport/link/tx/lease", round(1000 * lease_s))
    return config


def set_value(config: zenoh.Config, key: str, value: object) -> None:
    """Set one key of the configuration, or a whole section."""
    config.insert_json5(key, msgspec.json.encode(value).decode())
