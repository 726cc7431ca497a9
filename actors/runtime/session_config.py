"""What the configurations of all Zenoh sessions have in common."""

import msgspec
import zenoh


def session_config(mode: str) -> zenoh.Config:
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
    return config


def set_value(config: zenoh.Config, key: str, value: object) -> None:
    """Set one key of the configuration, or a whole section."""
    config.insert_json5(key, msgspec.json.encode(value).decode())
