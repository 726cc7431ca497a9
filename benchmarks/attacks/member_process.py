"""One process of the swarm under attack: the world (the router), or a robot that obeys an attacker's orders.

It reads its description and then one order per line from stdin and answers each with one line on stdout.
"""

import json
import os
import sys
from pathlib import Path
from typing import TextIO

import zenoh

from actors.runtime.access.credentials import reveal
from actors.runtime.isolation.sandbox import Confinement, isolate
from benchmarks.attacks.member import Description, Note, SwarmMember, client, router, sockets


def main() -> None:
    """Become the member that argv names."""
    name = sys.argv[1]
    # Isolation redirects stdout; the test is spoken to through copies.
    orders, answers = os.dup(0), os.dup(1)
    with os.fdopen(orders) as incoming, os.fdopen(answers, "w") as outgoing:
        swarm = Description(**json.loads(incoming.readline()))
        if swarm.mode == "isolated" and name != "world":
            own = Path(swarm.robots[name])
            kept = (orders, answers)
            isolate(
                Confinement(
                    own=own,
                    hidden=(Path(swarm.out), *map(Path, swarm.hidden)),
                    log=own / "log.txt",
                    descriptors=kept,
                    parent=os.getppid(),
                )
            )
        obey_all(name, swarm, incoming, outgoing)


def obey_all(name: str, swarm: Description, incoming: TextIO, outgoing: TextIO) -> None:
    """Open the session and carry out one order after the other."""
    with zenoh.open(router(swarm) if name == "world" else client(swarm, name)) as session:
        member = SwarmMember(name, swarm, session)
        member.ordinary = [session.declare_subscriber(key) for key in ordinary_keys(name)]
        if name == "world":
            reveal(sockets(swarm))
        answer: Note = {"ready": os.getpid()}
        while True:
            outgoing.write(json.dumps(answer) + "\n")
            outgoing.flush()
            order = incoming.readline()
            if not order:
                return
            answer = obey(member, json.loads(order))


def ordinary_keys(name: str) -> list[str]:
    """What a member listens to in the ordinary course of a run (the world: all that could be forged, too)."""
    if name == "world":
        return ["swarm/up/*/drive", "swarm/up/*/transmit", "swarm/up/*/ready", "swarm/infra/**", "foo"]
    return [f"swarm/down/{name}/senses", f"swarm/down/{name}/received"]


def obey(member: SwarmMember, order: Note) -> Note:
    """Carry out one stage of an attack."""
    from benchmarks.attacks.attacks import ATTACKS  # noqa: PLC0415 — brings threads, which isolation refuses

    if order.get("forget"):
        member.forget()
        return {}
    member.pid = order["pid"]
    _, act = ATTACKS[order["attack"]].stages[order["stage"]]
    try:
        return act(member, order["note"]) or {}
    except (OSError, zenoh.ZError, TimeoutError) as error:
        return {"refused": f"{member.name}: {type(error).__name__}: {error}"}


if __name__ == "__main__":
    main()
