"""Attacks over the router: forged and overheard messages, queries, tokens, and sessions under false names."""

from collections.abc import Callable
from typing import Any

import zenoh

from benchmarks.attacks.attack import Attack, Layer, eavesdrop, has_heard, mark, relay_mark
from benchmarks.attacks.member import Note, Stage, SwarmMember, client

SECRET_KEY = "swarm/down/r2/senses"
Act = Callable[[SwarmMember, Note], Note | None]
Stages = tuple[Stage, ...]


def sending(send: Callable[[SwarmMember, str], Any]) -> Stages:
    """r1 sends once r2 is known to listen; reached if r2 hears it or the world takes it for another's."""

    def act(member: SwarmMember, note: Note) -> None:
        send(member, note["token"])
        mark(member, note)

    return (*listening(), ("r1", act), ("world", relay_mark), ("r2", has_heard))


def listening() -> Stages:
    """r2 listens to everything, and the router knows."""
    return (("r2", eavesdrop), *greet("r2"))


def putting(key: str) -> Stages:
    """r1 puts on `key`."""
    return sending(lambda member, token: member.session.put(key, token))


def forged(name: str, key: str) -> Attack:
    """r1 puts on a key that is not its own."""
    return Attack(f"put on {name} `{key}`", Layer.RULES, "access rules", putting(key))


def publish(member: SwarmMember, token: str) -> None:
    """Put through a declared publisher."""
    member.keep(member.session.declare_publisher(SECRET_KEY)).put(token)


def delete(member: SwarmMember, token: str) -> None:
    """Delete, with the token beside it; the sample's payload is empty, so its key speaks."""
    member.session.delete(f"swarm/down/r2/{token}")


def heard_delete(member: SwarmMember, note: Note) -> Note:
    """Whether a delete has come on the key that bears the token."""
    member.await_payload(f"over {note['token']}")
    return {"reached": any(entry.key.endswith(note["token"]) for entry in member.hear())}


def session_as(member: SwarmMember, **changed: Any) -> zenoh.Session:
    """A second session of r1."""
    session: zenoh.Session = member.keep(zenoh.open(client(member.swarm, "r1", **changed)))
    return session


def put_in_mode(mode: str) -> Stages:
    """r1's own credentials in a session of another kind."""

    def act(member: SwarmMember, note: Note) -> None:
        session = session_as(member, mode=mode)
        session.put(SECRET_KEY, note["token"])
        session.put("swarm/up/r1/drive", f"mark {note['token']}")

    return (*listening(), ("r1", act), ("world", relay_mark), ("r2", has_heard))


def overhearing(key: str, secret_key: str, speaker: str, *, second: bool = False) -> Stages:
    """r1 subscribes to `key`; then `speaker` sends the token on `secret_key`."""

    def listen(member: SwarmMember, note: Note) -> None:
        session = session_as(member) if second else member.session
        member.listen(key, session)
        if second:
            member.listen("swarm/down/r1/senses", session)
        session.put("swarm/up/r1/drive", f"mark {note['token']}")

    def wait(member: SwarmMember, note: Note) -> None:
        member.await_payload(f"mark {note['token']}")

    def speak(member: SwarmMember, note: Note) -> None:
        member.session.put(secret_key, note["token"])
        member.session.put(f"swarm/up/{member.name}/drive", f"end {note['token']}")

    def check(member: SwarmMember, note: Note) -> Note:
        # Two copies: one of them has come to the second session, behind whatever came there.
        member.await_payload(f"over {note['token']}", copies=2 if second else 1)
        return {"reached": member.has_heard(note["token"])}

    return (("r1", listen), ("world", wait), (speaker, speak), ("world", pass_end), ("r1", check))


def pass_end(member: SwarmMember, note: Note) -> None:
    """The speaker's last word has come; tell r1."""
    member.await_payload(f"end {note['token']}")
    member.session.put("swarm/down/r1/senses", f"over {note['token']}")


def overheard(key: str, secret_key: str, speaker: str) -> Attack:
    """r1 subscribes to what is meant for others."""
    name = f"subscribe to `{key}`, {speaker} speaking on `{secret_key}`"
    return Attack(name, Layer.RULES, "access rules", overhearing(key, secret_key, speaker))


def answer_queries(key: str) -> Act:
    """Declare a queryable that answers with the token."""

    def act(member: SwarmMember, note: Note) -> None:
        token = note["token"]
        member.keep(member.session.declare_queryable(key, lambda query: query.reply(query.key_expr, token)))

    return act


def ask(key: str) -> Act:
    """Query, and see whether the token is the answer."""

    def act(member: SwarmMember, note: Note) -> Note:
        replies = [reply.ok for reply in member.session.get(key, timeout=0.5)]
        return {"reached": any(r is not None and bytes(r.payload).decode() == note["token"] for r in replies)}

    return act


def settle(asker: str, word: str = "settled") -> Stages:
    """Let what r1 declared reach the router, and what follows from it `asker`, over allowed keys."""

    def say(member: SwarmMember, note: Note) -> None:
        member.session.put("swarm/up/r1/drive", f"{word} {note['token']}")

    def relay(member: SwarmMember, note: Note) -> None:
        member.await_payload(f"{word} {note['token']}")
        member.session.put(f"swarm/down/{asker}/senses", f"{word}, {note['token']}")

    def check(member: SwarmMember, note: Note) -> None:
        member.await_payload(f"{word}, {note['token']}")

    return (("r1", say), ("world", relay), (asker, check))


def greet(speaker: str) -> Stages:
    """Let what `speaker` declared reach the router."""

    def say(member: SwarmMember, note: Note) -> None:
        member.session.put(f"swarm/up/{member.name}/drive", f"hello {note['token']}")

    def wait(member: SwarmMember, note: Note) -> None:
        member.await_payload(f"hello {note['token']}")

    return ((speaker, say), ("world", wait))


def declare_token(member: SwarmMember, note: Note) -> None:
    """Declare liveliness on a key that bears the token."""
    member.keep(member.session.liveliness().declare_token(f"swarm/up/r1/{note['token']}"))


def see_token(member: SwarmMember, note: Note) -> Note:
    """Ask who is alive."""
    replies = [reply.ok for reply in member.session.liveliness().get("swarm/**", timeout=0.5)]
    return {"reached": any(r is not None and str(r.key_expr).endswith(note["token"]) for r in replies)}


def watch_tokens(member: SwarmMember, _: Note) -> None:
    """Subscribe to liveliness everywhere."""
    member.listen_for_life("**")


def saw_token(member: SwarmMember, note: Note) -> Note:
    """Whether a token has appeared."""
    return {"reached": any(entry.key.endswith(note["token"]) for entry in member.hear())}


def watch_matching(member: SwarmMember, note: Note) -> Note:
    """Declare a publisher and see whether anybody listens already."""
    publisher = member.keep(member.session.declare_publisher("swarm/up/r1/whisper"))
    return {"before": bool(publisher.matching_status.matching)}


def nod(member: SwarmMember, note: Note) -> None:
    """Say yes by listening to a key of r1's."""
    member.listen("swarm/up/r1/whisper")
    member.session.put("swarm/up/r2/drive", f"end {note['token']}")


def see_nod(member: SwarmMember, note: Note) -> Note:
    """Whether the publisher now knows of a listener."""
    member.await_payload(f"over {note['token']}")
    return {"reached": bool(member.kept[0].matching_status.matching) != note["before"]}


def hold_id(member: SwarmMember, note: Note) -> None:
    """Open a session under an id that the two have agreed upon before the run."""
    member.keep(zenoh.open(client(member.swarm, "r2", id=f"a{note['token']}")))


def find_id_held(member: SwarmMember, note: Note) -> Note:
    """The router takes a session id once only."""
    try:
        session_as(member, id=f"a{note['token']}")
    except zenoh.ZError:
        return {"reached": True}
    return {"reached": False}


def opens(**changed: Any) -> Stages:
    """Whether the router takes a session with these credentials."""

    def act(member: SwarmMember, _: Note) -> Note:
        session_as(member, **changed)
        return {"reached": True}

    return (("r1", act),)


def stranger(name: str, **changed: Any) -> Attack:
    """r1 shows credentials that are not its own."""
    return Attack(name, Layer.RULES, "passwords", opens(**changed))


def rule(name: str, stages: Stages) -> Attack:
    """An attack that the access rules close."""
    return Attack(name, Layer.RULES, "access rules", stages)


CONTROLS = (
    Attack(
        "control: r1 puts on its own `swarm/up/r1/drive`",
        Layer.NONE,
        "nothing",
        putting("swarm/up/r1/drive"),
    ),
    Attack(
        "control: r1 hears its own `swarm/down/r1/senses`",
        Layer.NONE,
        "nothing",
        overhearing("swarm/down/r1/**", "swarm/down/r1/senses", "world"),
    ),
)
BUS_ATTACKS = (
    forged("r2's", "swarm/up/r2/drive"),
    forged("r2's", "swarm/up/r2/transmit"),
    forged("r2's", "swarm/up/r2/ready"),
    forged("r2's", "swarm/down/r2/senses"),
    forged("r2's", "swarm/down/r2/received"),
    forged("its own incoming key", "swarm/down/r1/senses"),
    forged("the others'", "swarm/infra/truth"),
    forged("the others'", "swarm/infra/control"),
    forged("the others'", "swarm/infra/ready"),
    forged("a key of nobody", "foo"),
    forged("a wildcard", "swarm/up/*/drive"),
    forged("a wildcard", "swarm/down/*/senses"),
    forged("a wildcard", "swarm/**"),
    rule("put through a declared publisher on r2's key", sending(publish)),
    rule(
        "delete on r2's key",
        (*sending(delete)[:-1], ("r2", heard_delete)),
    ),
    overheard("swarm/down/r2/senses", "swarm/down/r2/senses", "world"),
    overheard("swarm/down/*/senses", "swarm/down/r2/senses", "world"),
    overheard("swarm/**", "swarm/down/r2/received", "world"),
    overheard("**", "swarm/down/r2/senses", "world"),
    overheard("swarm/infra/**", "swarm/infra/truth", "world"),
    overheard("swarm/up/r2/**", "swarm/up/r2/transmit", "r2"),
    overheard("swarm/up/**", "swarm/up/r2/drive", "r2"),
    overheard("**", "foo", "r2"),
    rule(
        "query to the world",
        (("world", answer_queries("swarm/infra/state")), ("r1", ask("swarm/infra/state"))),
    ),
    rule(
        "query from r2 to a queryable of r1",
        (("r1", answer_queries("swarm/up/r1/state")), *settle("r2"), ("r2", ask("swarm/up/r1/state"))),
    ),
    rule(
        "queryable of r1 on a key of the world's",
        (("r1", answer_queries("swarm/infra/state")), *settle("r1"), ("world", ask("swarm/infra/state"))),
    ),
    rule("liveliness token, r2 asking for it", (("r1", declare_token), *settle("r2"), ("r2", see_token))),
    rule(
        "liveliness token, r2 subscribed to it",
        (("r2", watch_tokens), *greet("r2"), ("r1", declare_token), *settle("r2"), ("r2", saw_token)),
    ),
    rule(
        "one bit by subscribing to a key that r1 publishes on",
        (("r1", watch_matching), ("r2", nod), ("world", pass_end), ("r1", see_nod)),
    ),
    rule("put on r2's key in a session of mode peer", put_in_mode("peer")),
    rule("put on r2's key in a session of mode router", put_in_mode("router")),
    rule(
        "second session with its own password, subscribed to `swarm/**`",
        overhearing("swarm/**", SECRET_KEY, "world", second=True),
    ),
    Attack(
        "one bit by holding a session id agreed upon beforehand",
        Layer.REMAINS,
        "nothing",
        (("r2", hold_id), ("r1", find_id_held)),
    ),
    stranger("session with a wrong password", password="guessed"),
    stranger("session without a password", user=None, password=None),
    stranger("session of an unknown user", user="nobody"),
    stranger("session under r2's name", user="r2"),
    stranger("session under the radio's name", user="radio"),
)
