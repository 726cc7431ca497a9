"""A swarm to be attacked: the world as the router and two robots, each a process that takes orders."""

import json
import os
import secrets
import shutil
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple

from actors.runtime.access.credentials import issue
from actors.runtime.lifecycle import environment, process_table
from benchmarks.attacks.attack import Layer
from benchmarks.attacks.attacks import ATTACKS
from benchmarks.attacks.member import Description, Note
from benchmarks.attacks.network_attacks import REPOSITORY

MODES = {"unguarded": Layer.NONE, "open": Layer.RULES, "isolated": Layer.PROCESS}
"""What a swarm is protected by: nothing, what --no-isolate leaves, everything."""


class StageOutcome(NamedTuple):
    """Whether an attack reached its goal, and what stood in its way if the system said so."""

    reached: bool
    refused: str


class AttackedSwarm:
    """Three processes and their folders; `with` starts and ends them."""

    def __init__(self, mode: str) -> None:
        # Short, because a socket's path may have 107 bytes.
        self._study = Path(tempfile.mkdtemp(prefix="swarm", dir="/tmp")).resolve()
        (self._study / "strategy.py").write_text("")
        (self._study / "scenario.toml").write_text("[run]\nseed = 7\n")
        self.out = self._study / "runs" / "this"
        self.out.mkdir(parents=True)
        self._other = _other_run(self._study / "runs" / "other")
        robots = {name: self.out / name for name in ("r1", "r2")}
        infra = self.out / "infra"
        for folder in (*robots.values(), infra):
            folder.mkdir()
        issue(robots, infra)
        self._inherited = [os.open(self.out, os.O_RDONLY), *os.pipe()]
        os.set_blocking(self._inherited[1], False)
        self.description = Description(
            mode=mode,
            out=str(self.out),
            robots={name: str(folder) for name, folder in robots.items()},
            infra=str(infra),
            study=str(self._study),
            other=str(self._study / "runs" / "other"),
            hidden=[str(self._study / "scenario.toml")],
            inherited=dict(zip(("folder", "pipe_out", "pipe_in"), self._inherited, strict=True)),
        )
        self._members: dict[str, subprocess.Popen[str]] = {}
        self._litter: set[str] = set()

    def __enter__(self) -> "AttackedSwarm":
        try:
            for group in (("world",), ("r1", "r2")):
                for name in group:
                    self._start(name)
                for name in group:
                    self._answer(name)
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        for member in reversed(self._members.values()):
            assert member.stdin is not None
            with suppress(BrokenPipeError):
                member.stdin.close()
        for member in self._members.values():
            try:
                member.wait(10)
            except subprocess.TimeoutExpired:
                member.kill()
        for handle in self._inherited:
            os.close(handle)
        for path in self._litter:
            Path(path).unlink(missing_ok=True)
        self._other.close()
        shutil.rmtree(self._study, ignore_errors=True)

    def carry_out(self, index: int) -> StageOutcome:
        """Carry out one attack of the table, then let everyone forget it."""
        note: Note = {"token": secrets.token_hex(8)}
        for stage, (name, _) in enumerate(ATTACKS[index].stages):
            order = {"attack": index, "stage": stage, "note": note, "pid": self._pid(name)}
            note |= self._ask(name, order)
            if "refused" in note:
                break
            self._litter.update(note.pop("litter", ()))
        for name in self._members:
            self._ask(name, {"forget": True})
        refused = note.get("refused", "")
        return StageOutcome(bool(note.get("reached")) and not refused, refused)

    def _start(self, name: str) -> None:
        self._members[name] = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.attacks.member_process", name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=self.out,
            env=self._environment(),
            pass_fds=self._inherited,
        )
        self._write(name, self.description._asdict())

    def _pid(self, name: str) -> int:
        """Of the member itself; an isolated one was started later than process 1 beside it."""
        outer = self._members[name].pid
        if self.description.mode != "isolated" or name == "world":
            return outer
        return max(process_table.children(outer, process_table.table()))

    def _environment(self) -> dict[str, str]:
        """What the members are told: everything the user's shell knows, or what launchers let through."""
        shell = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join((str(REPOSITORY), str(self._study))),
            "SECRET": "known to its owner only",
        }
        return environment.passed_on(shell) if self.description.mode == "isolated" else shell

    def _ask(self, name: str, order: Note) -> Note:
        self._write(name, order)
        return self._answer(name)

    def _write(self, name: str, order: Note) -> None:
        stdin = self._members[name].stdin
        assert stdin is not None
        stdin.write(json.dumps(order) + "\n")
        stdin.flush()

    def _answer(self, name: str) -> Note:
        stdout: IO[str] | None = self._members[name].stdout
        assert stdout is not None
        line = stdout.readline()
        if not line:
            log = self.out / name / "log.txt"
            raise RuntimeError(f"{name} ended: {log.read_text()[-2000:] if log.exists() else 'see above'}")
        answer: Note = json.loads(line)
        return answer


def _other_run(out: Path) -> socket.socket:
    """What another run keeps in its folder while it is going on; its router's socket."""
    for name in ("world", "r9"):
        (out / name).mkdir(parents=True)
    (out / "scenario.toml").write_text("[run]\nseed = 8\n")
    (out / "r9" / "r9.mcap").write_text("what r9 was told")
    (out / "world" / "operator.credentials").write_text("operator:secret\n")
    router = socket.socket(socket.AF_UNIX)
    router.bind(str(out / "world" / "router.sock"))
    router.listen()
    return router
