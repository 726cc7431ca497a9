"""Test rig of the attacks: the world's router and two robots, processes that execute stages of attacks."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: isolation needs a process of one thread

import json
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import zenoh

from actors.installation.repository import REPOSITORY
from actors.runtime import process_table
from actors.runtime.isolation import rules
from actors.runtime.isolation.credentials import Credentials, issue, publish_sockets
from actors.runtime.isolation.mounts import file_view
from actors.runtime.isolation.sandbox import SandboxSetup, isolate
from actors.runtime.linux import create_log, redirect_output

Note = dict[str, Any]
"""Data that the stages of one attack share through the test instead of the swarm."""
TIMEOUT_S = 10.0
"""Limit for messages that must arrive; absence is never concluded from a shorter wait."""
NO_PASSWORDS = '{"user": null, "password": null, "dictionary_file": null}'
ORDINARY_KEYS = ("swarm/up/*/drive", "swarm/up/*/transmit", "swarm/up/*/ready", "swarm/infra/**")


class Layer(IntEnum):
    NONE = 0
    """Positive control: must succeed in every mode."""
    RULES = 1
    """Passwords and access rules of the router."""
    PROCESS = 2
    """The sandbox of the robot process."""


MODES = {"unguarded": Layer.NONE, "open": Layer.RULES, "isolated": Layer.PROCESS}
""""unguarded": no rules or passwords; "open": those of --no-isolate; "isolated": sandboxed robots as well."""


class Description(NamedTuple):
    mode: str
    study: str
    """Folder with the robots' code and the scenario; holds `out` and the run folder `runs/other`."""
    inherited: int
    """A descriptor of `out` that is left open."""

    @property
    def out(self) -> Path:
        return Path(self.study, "runs", "this")

    @property
    def infra(self) -> Path:
        return self.out / "infra"

    @property
    def robots(self) -> dict[str, Path]:
        return {name: self.out / name for name in ("r1", "r2")}


@dataclass
class SwarmMember:
    name: str
    swarm: Description
    session: zenoh.Session
    pid: int = 0
    """Process id outside its namespace."""
    heard: list[str] = field(default_factory=list)
    """Payloads of received samples."""
    ordinary: list[Any] = field(default_factory=list)
    subscribers: list[Any] = field(default_factory=list)
    kept: list[Any] = field(default_factory=list)
    signals: list[int] = field(default_factory=list)

    @property
    def folder(self) -> Path:
        return self.swarm.robots.get(self.name, self.swarm.infra)

    def keep(self, thing: Any) -> Any:
        self.kept.append(thing)
        return thing

    def listen(self, key: str) -> None:
        self.subscribers.append(self.session.declare_subscriber(key))

    def receive(self) -> list[str]:
        for subscriber in (*self.ordinary, *self.subscribers):
            while (sample := subscriber.try_recv()) is not None:
                self.heard.append(bytes(sample.payload).decode())
        return self.heard

    def has_heard(self, payload: str) -> bool:
        return payload in self.receive()

    def await_payload(self, payload: str) -> None:
        limit = time.monotonic() + TIMEOUT_S
        while payload not in self.receive():
            if time.monotonic() > limit:
                raise AssertionError(f"{self.name} never received {payload!r}, only {self.heard}")
            time.sleep(0.0005)

    def reset(self) -> None:
        for thing in (*self.subscribers, *reversed(self.kept)):
            with suppress(OSError, zenoh.ZError):
                thing.close() if hasattr(thing, "close") else thing.undeclare()
        for things in (self.subscribers, self.kept, self.signals):
            things.clear()
        self.receive()
        self.heard.clear()


Stage = tuple[str, Callable[[SwarmMember, Note], Note | bool | None]]
"""A member's name and its action; a returned truth is `reached`, returned items are added to the note."""


class Attack(NamedTuple):
    """An attempt of r1 to reach r2 or to act as another actor.

    The attack succeeds if its stages end with a true note `reached`; a refused call ends it before.
    """

    name: str
    layer: Layer
    stages: tuple[Stage, ...]
    traces: bool = False
    """Needs the right to trace own processes (Yama's ptrace_scope)."""


class AttackedSwarm:
    def __init__(self, mode: str) -> None:
        self._stack = ExitStack()
        # Short, because a socket's path may have 107 bytes.
        study = Path(tempfile.mkdtemp(prefix="swarm", dir="/tmp")).resolve()
        self._stack.callback(shutil.rmtree, study, ignore_errors=True)
        (study / "scenario.toml").write_text("[run]\nseed = 7\n")
        (study / "runs" / "other" / "r9").mkdir(parents=True)
        (study / "runs" / "other" / "r9" / "r9.mcap").write_text("recording of r9")
        swarm = Description(mode, str(study), 0)
        for folder in (*swarm.robots.values(), swarm.infra):
            folder.mkdir(parents=True)
        issue(swarm.robots, swarm.infra)
        self._swarm = swarm._replace(inherited=os.open(swarm.out, os.O_RDONLY))
        self._stack.callback(os.close, self._swarm.inherited)
        self._members: dict[str, subprocess.Popen[str]] = {}

    def __enter__(self) -> "AttackedSwarm":
        try:
            for group in (("world",), ("r1", "r2")):
                for name in group:
                    self._start(name)
                for name in group:
                    self._answer(name)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for member in reversed(self._members.values()):
            assert member.stdin is not None
            with suppress(BrokenPipeError):
                member.stdin.close()
        for member in self._members.values():
            try:
                member.wait(10)
            except subprocess.TimeoutExpired:
                member.kill()
        self._stack.close()

    def run_campaign(self, attack: Attack) -> tuple[bool, str]:
        note: Note = {"token": secrets.token_hex(8)}
        for stage, (name, _) in enumerate(attack.stages):
            order = {"attack": attack.name, "stage": stage, "note": note, "pid": self._pid(name)}
            note |= self._ask(name, order)
            if "refused" in note:
                break
        for name in self._members:
            self._ask(name, {"reset": True})
        if "litter" in note:
            Path(note["litter"]).unlink(missing_ok=True)
        refused = note.get("refused", "")
        return bool(note.get("reached")) and not refused, refused

    def _start(self, name: str) -> None:
        path = os.pathsep.join((str(REPOSITORY), self._swarm.study))
        shell = {**os.environ, "PYTHONPATH": path, "SECRET": "known to its owner only"}
        isolated = self._swarm.mode == "isolated"
        self._members[name] = subprocess.Popen(
            [sys.executable, "-m", "tests.isolation.attacked_swarm", name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=self._swarm.out,
            env=process_table.child_environment(shell) if isolated else shell,
            pass_fds=[self._swarm.inherited],
        )
        self._write(name, self._swarm._asdict())

    def _pid(self, name: str) -> int:
        outer = self._members[name].pid
        alone = self._swarm.mode != "isolated" or name == "world"
        return outer if alone else max(process_table.children(outer, process_table.processes()))

    def _ask(self, name: str, order: Note) -> Note:
        self._write(name, order)
        return self._answer(name)

    def _write(self, name: str, order: Note) -> None:
        stdin = self._members[name].stdin
        assert stdin is not None
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()

    def _answer(self, name: str) -> Note:
        stdout = self._members[name].stdout
        assert stdout is not None
        line = stdout.readline()
        if not line:
            log = self._swarm.out / name / "log.txt"
            raise RuntimeError(f"{name} exited: {log.read_text()[-2000:] if log.exists() else 'see above'}")
        answer: Note = json.loads(line)
        return answer


def credentials_of(swarm: Description) -> Credentials:
    robots, infra = swarm.robots, swarm.infra
    return Credentials(
        robots=tuple(robots),
        others=("radio", "observer", "operator"),
        dictionary=infra / "users",
        files={name: folder / "credentials" for name, folder in robots.items()},
        sockets={name: folder / "router.sock" for name, folder in robots.items()}
        | {"radio": infra / "router.sock"},
    )


def router(swarm: Description) -> zenoh.Config:
    config = rules.router_config(credentials_of(swarm))
    if swarm.mode == "unguarded":
        config.insert_json5("access_control", '{"enabled": false}')
        config.insert_json5("transport/auth/usrpwd", NO_PASSWORDS)
    return config


def client(swarm: Description, name: str, **changed: Any) -> zenoh.Config:
    issued = credentials_of(swarm)
    config = rules.client_config(issued.files[name], issued.endpoint(name))
    for key, value in changed.items():
        config.insert_json5(key if key == "mode" else f"transport/auth/usrpwd/{key}", json.dumps(value))
    if swarm.mode == "unguarded":  # a router without passwords refuses a client that shows one
        config.insert_json5("transport/auth/usrpwd", NO_PASSWORDS)
    return config


def main() -> None:
    name = sys.argv[1]
    orders, answers = os.dup(0), os.dup(1)  # isolation redirects stdin and stdout
    with os.fdopen(orders) as incoming, os.fdopen(answers, "w") as outgoing:
        swarm = Description(**json.loads(incoming.readline()))
        if swarm.mode == "isolated" and name != "world":
            own = swarm.robots[name]
            view = file_view(own, (swarm.out, Path(swarm.study, "scenario.toml")))
            redirect_output(create_log(own / "log.txt"))
            isolate(lambda: SandboxSetup(view), (1, 2, orders, answers), parent=os.getppid())
            os.chdir(own)
        with zenoh.open(router(swarm) if name == "world" else client(swarm, name)) as session:
            member = SwarmMember(name, swarm, session)
            keys = ORDINARY_KEYS if name == "world" else (f"swarm/down/{name}/*",)
            member.ordinary = [session.declare_subscriber(key) for key in keys]
            if name == "world":
                publish_sockets(credentials_of(swarm))
            _obey_all(member, incoming, outgoing)


def _obey_all(member: SwarmMember, incoming: TextIO, outgoing: TextIO) -> None:
    answer: Note = {"ready": os.getpid()}
    while True:
        outgoing.write(json.dumps(answer) + "\n")
        outgoing.flush()
        order = incoming.readline()
        if not order:
            return
        answer = _obey(member, json.loads(order))


def _obey(member: SwarmMember, order: Note) -> Note:
    from tests.isolation.attacks import ATTACKS  # noqa: PLC0415 — the table imports this module

    if order.get("reset"):
        member.reset()
        return {}
    member.pid = order["pid"]
    (attack,) = (one for one in ATTACKS if one.name == order["attack"])
    try:
        result = attack.stages[order["stage"]][1](member, order["note"])
        return {"reached": result} if isinstance(result, bool) else result or {}
    except (OSError, zenoh.ZError, TimeoutError) as error:
        return {"refused": f"{member.name}: {type(error).__name__}: {error}"}


if __name__ == "__main__":
    from tests.isolation.attacked_swarm import main as imported_main  # the module as attacks.py imports it

    imported_main()
