"""A member of the swarm under attack: its session, what it hears, and what it must let go of afterwards."""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import zenoh

from actors.runtime.access import rules
from actors.runtime.access.credentials import Credentials

Note = dict[str, Any]
"""What the stages of one attack tell each other, through the test and not through the swarm."""

PATIENCE = 10.0
"""How long a message that must arrive is waited for, s; a shorter wait is never used to show an absence."""

NO_PASSWORDS = '{"user": null, "password": null, "dictionary_file": null}'


class Description(NamedTuple):
    """Everything a member needs to know about its swarm."""

    mode: str
    """"unguarded": no rules, no passwords; "open": those of --no-isolate; "isolated": everything."""
    out: str
    robots: dict[str, str]
    infra: str
    study: str
    """Folder with the robots' code, on Python's path; the output folder is in it, and `other`."""
    other: str
    """Output folder of another run that is going on."""
    hidden: list[str]
    """What else the robots must not see: the scenario, which lies beside their code."""
    inherited: dict[str, int]
    """Descriptors that a careless starter has left open: the folder `out`, and the two ends of a pipe."""


class Overheard(NamedTuple):
    """One sample that reached a member."""

    key: str
    payload: str


@dataclass
class SwarmMember:
    """The process's own state: its session, what it heard, what it must let go of after an attack."""

    name: str
    swarm: Description
    session: zenoh.Session
    pid: int = 0
    """This process's number as the system knows it, which is another one than in its own namespace."""
    heard: list[Overheard] = field(default_factory=list)
    ordinary: list[Any] = field(default_factory=list)
    ears: list[Any] = field(default_factory=list)
    kept: list[Any] = field(default_factory=list)
    signals: list[int] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        """This member's own folder."""
        return Path(self.swarm.robots.get(self.name, self.swarm.infra))

    def keep(self, thing: Any) -> Any:
        """Hold `thing` until the attack is over."""
        self.kept.append(thing)
        return thing

    def listen(self, key: str, session: zenoh.Session | None = None) -> None:
        """Hear what arrives on `key` until the attack is over."""
        self.ears.append((session or self.session).declare_subscriber(key))

    def listen_for_life(self, key: str) -> None:
        """Hear who is alive on `key` until the attack is over."""
        self.ears.append(self.session.liveliness().declare_subscriber(key))

    def hear(self) -> list[Overheard]:
        """All that has arrived since the attack began.

        Read from channels and not told by callbacks: each callback has its own thread, and then what came
        first may be told last.
        """
        for ear in (*self.ordinary, *self.ears):
            while (sample := ear.try_recv()) is not None:
                self.heard.append(Overheard(str(sample.key_expr), bytes(sample.payload).decode()))
        return self.heard

    def has_heard(self, payload: str) -> bool:
        """True if a sample with `payload` has arrived."""
        return any(entry.payload == payload for entry in self.hear())

    def await_payload(self, payload: str, copies: int = 1) -> None:
        """Wait for a sample that must come; everything sent before it on its way is then here too."""
        limit = time.monotonic() + PATIENCE
        while [entry.payload for entry in self.hear()].count(payload) < copies:
            if time.monotonic() > limit:
                raise AssertionError(f"{self.name} never got {payload!r}, only {self.heard}")
            time.sleep(0.0005)

    def forget(self) -> None:
        """Let go of everything that the last attack left."""
        for thing in (*self.ears, *reversed(self.kept)):
            with suppress(OSError, zenoh.ZError):
                thing.close() if hasattr(thing, "close") else thing.undeclare()
        for things in (self.ears, self.kept, self.signals):
            things.clear()
        self.hear()
        self.heard.clear()


Stage = tuple[str, Callable[[SwarmMember, Note], Note | None]]
"""A member's name and what it does; what it returns is added to the note."""


def sockets(swarm: Description) -> Credentials:
    """Where the credentials of the run lie, as `issue` has written them."""
    robots = {name: Path(folder) for name, folder in swarm.robots.items()}
    infra = Path(swarm.infra)
    return Credentials(
        robots=tuple(robots),
        others=("radio", "observer", "operator"),
        dictionary=infra / "users",
        files={name: folder / "credentials" for name, folder in robots.items()},
        sockets={name: folder / "router.sock" for name, folder in robots.items()}
        | {"radio": infra / "router.sock"},
    )


def router(swarm: Description) -> zenoh.Config:
    """The world's configuration; in the unguarded swarm without its guards."""
    config = rules.router_config(sockets(swarm))
    if swarm.mode == "unguarded":
        config.insert_json5("access_control", '{"enabled": false}')
        config.insert_json5("transport/auth/usrpwd", NO_PASSWORDS)
    return config


def client(swarm: Description, name: str, **changed: Any) -> zenoh.Config:
    """A robot's configuration with its own credentials; `changed` replaces its parts."""
    issued = sockets(swarm)
    config = rules.client_config(issued.files[name], issued.endpoint(name))
    for key, value in changed.items():
        path = key if key in {"mode", "id"} else f"transport/auth/usrpwd/{key}"
        config.insert_json5(path, json.dumps(value))
    if swarm.mode == "unguarded":
        # A router that wants no password refuses a client that shows one.
        config.insert_json5("transport/auth/usrpwd", NO_PASSWORDS)
    return config
