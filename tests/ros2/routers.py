"""A Zenoh router as on a ROS 2 robot."""

import zenoh

from actors.runtime.isolation.rules import session_config, set_value


def start_router(port: int) -> zenoh.Session:
    """Return a router that listens on 127.0.0.1."""
    config = session_config("router")
    set_value(config, "transport/unicast/lowlatency", False)
    set_value(config, "listen/endpoints", [f"tcp/127.0.0.1:{port}"])
    return zenoh.open(config)
