"""Attacks past the router: sockets of every family, and Zenoh without the router."""

import socket
import time
from pathlib import Path

import zenoh

from benchmarks.attacks.attack import Attack, Layer
from benchmarks.attacks.member import Note, Stage, SwarmMember

MULTICAST = "239.7.7.7"
WAIT = 0.3
"""For what has been sent before anyone looks, s."""
REPOSITORY = Path(__file__).resolve().parents[2]


def accept(member: SwarmMember, note: Note) -> Note:
    """Take a connection that is there already and read the token from it."""
    listener: socket.socket = member.kept[0]
    listener.settimeout(WAIT)
    connection, _ = listener.accept()
    with connection:
        connection.settimeout(WAIT)
        return {"reached": connection.recv(100).decode() == note["token"]}


def receive(member: SwarmMember, note: Note) -> Note:
    """Read a datagram that is there already."""
    receiver: socket.socket = member.kept[0]
    receiver.settimeout(WAIT)
    return {"reached": receiver.recv(100).decode() == note["token"]}


def listen_tcp(member: SwarmMember, _: Note) -> Note:
    """Listen on loopback TCP."""
    listener = member.keep(socket.create_server(("127.0.0.1", 0)))
    return {"port": listener.getsockname()[1]}


def connect_tcp(_: SwarmMember, note: Note) -> None:
    """Connect over loopback TCP and send the token."""
    with socket.create_connection(("127.0.0.1", note["port"]), timeout=WAIT) as connection:
        connection.sendall(note["token"].encode())


def listen_udp(member: SwarmMember, _: Note) -> Note:
    """Listen on loopback UDP."""
    receiver = member.keep(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    receiver.bind(("127.0.0.1", 0))
    return {"port": receiver.getsockname()[1]}


def send_udp(_: SwarmMember, note: Note) -> None:
    """Send the token over loopback UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(note["token"].encode(), ("127.0.0.1", note["port"]))


def join_group(member: SwarmMember, _: Note) -> Note:
    """Listen to a multicast group on the loopback interface."""
    receiver = member.keep(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    receiver.bind(("", 0))
    group = socket.inet_aton(MULTICAST) + socket.inet_aton("127.0.0.1")
    receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
    return {"port": receiver.getsockname()[1]}


def send_to_group(_: SwarmMember, note: Note) -> None:
    """Send the token to the multicast group."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sender.sendto(note["token"].encode(), (MULTICAST, note["port"]))


def peer(endpoint: str, role: str) -> zenoh.Config:
    """A Zenoh peer that knows no router."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("connect/timeout_ms", "1500")
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5(f"{role}/endpoints", f'["{endpoint}"]')
    return config


def free_port(_: SwarmMember, __: Note) -> Note:
    """A port for a peer to listen on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return {"port": probe.getsockname()[1]}


def listen_as_peer(member: SwarmMember, note: Note) -> None:
    """Open a Zenoh peer that others may connect to."""
    member.listen("**", member.keep(zenoh.open(peer(f"tcp/127.0.0.1:{note['port']}", "listen"))))


def connect_as_peer(member: SwarmMember, note: Note) -> None:
    """Connect to the other's peer and put the token, again until somebody listens."""
    session = member.keep(zenoh.open(peer(f"tcp/127.0.0.1:{note['port']}", "connect")))
    publisher = member.keep(session.declare_publisher("hello"))
    for _ in range(500):
        if publisher.matching_status.matching:
            break
        time.sleep(0.01)
    publisher.put(note["token"])


def heard_by_peer(member: SwarmMember, note: Note) -> Note:
    """The token has come past the router."""
    member.await_payload(note["token"])
    return {"reached": True}


def folder_of(member: SwarmMember, folder: str) -> Path:
    """A folder by its name; `out` and `repository` stand for themselves."""
    places = {"out": Path(member.swarm.out), "repository": REPOSITORY, "home": Path.home()}
    return places.get(folder, Path(folder))


def at_path(folder: str) -> tuple[Stage, ...]:
    """A Unix socket in a folder that both know."""

    def listen(member: SwarmMember, note: Note) -> Note:
        path = folder_of(member, folder) / f".{note['token']}"
        listener = member.keep(socket.socket(socket.AF_UNIX))
        listener.bind(str(path))
        listener.listen()
        return {"path": str(path), "litter": [str(path)]}

    return (("r2", listen), ("r1", connect_unix), ("r2", accept))


def connect_unix(_: SwarmMember, note: Note) -> None:
    """Connect to a Unix socket and send the token."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(note["path"])
        connection.sendall(note["token"].encode())


def listen_abstract(member: SwarmMember, note: Note) -> Note:
    """Listen on an abstract Unix socket."""
    listener = member.keep(socket.socket(socket.AF_UNIX))
    listener.bind("\0" + note["token"])
    listener.listen()
    return {"path": "\0" + note["token"]}


def connect_to_router(robot: str) -> tuple[Stage, ...]:
    """Connect to the router's socket of another actor."""

    def act(member: SwarmMember, _: Note) -> Note:
        folder = member.swarm.robots.get(robot, member.swarm.infra)
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(f"{folder}/router.sock")
        return {"reached": True}

    return (("r1", act),)


def open_vsock(_: SwarmMember, __: Note) -> Note:
    """Open a socket of a family that knows no network namespaces."""
    with socket.socket(socket.AF_VSOCK, socket.SOCK_STREAM):
        return {"reached": True}


def process(name: str, closed_by: str, *stages: Stage, folder: str = "") -> Attack:
    """An attack that only the isolation of the process closes."""
    return Attack(name, Layer.PROCESS, closed_by, stages, folder)


NETWORK = "network namespace"
TREE = "file tree"
NETWORK_ATTACKS = (
    process("TCP over loopback", NETWORK, ("r2", listen_tcp), ("r1", connect_tcp), ("r2", accept)),
    process("UDP over loopback", NETWORK, ("r2", listen_udp), ("r1", send_udp), ("r2", receive)),
    process("UDP multicast", NETWORK, ("r2", join_group), ("r1", send_to_group), ("r2", receive)),
    process(
        "Zenoh between the robots, past the router",
        NETWORK,
        ("r2", free_port),
        ("r2", listen_as_peer),
        ("r1", connect_as_peer),
        ("r2", heard_by_peer),
    ),
    process("abstract Unix socket", NETWORK, ("r2", listen_abstract), ("r1", connect_unix), ("r2", accept)),
    *(
        process(f"Unix socket in {place}", TREE, *at_path(folder), folder=folder)
        for folder, place in (
            ("/tmp", "/tmp"),
            ("/run", "/run"),
            ("/dev/shm", "/dev/shm"),
            ("out", "the run's output folder"),
            ("repository", "the repository"),
        )
    ),
    process("router socket of r2", TREE, *connect_to_router("r2")),
    process("router socket of the radio", TREE, *connect_to_router("infra")),
    process("vsock", "system call filter", ("r1", open_vsock)),
)
