"""Credentials, configurations and rules, without a router."""

import json
from pathlib import Path

import pytest

from actors.messages import TOPICS
from actors.runtime.isolation import credentials, rules
from actors.runtime.isolation.credentials import issue
from tests.refusals import refused


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    for name in ("r1", "r2", "infra"):
        (tmp_path / name).mkdir()
    return tmp_path


def robots(folders: Path) -> dict[str, Path]:
    return {name: folders / name for name in ("r1", "r2")}


def test_every_actor_has_a_private_password(folders: Path) -> None:
    issued = issue(robots(folders), folders / "infra")
    assert issued.robots == ("r1", "r2")
    assert issued.others == ("radio", "observer", "operator")
    files = [*issued.files.values(), issued.dictionary]
    assert {file.stat().st_mode & 0o777 for file in files} == {0o600}
    pairs = [credentials.read(file) for file in issued.files.values()]
    assert [user for user, _ in pairs] == ["r1", "r2", "radio", "observer", "operator"]
    assert len({password for _, password in pairs}) == 5
    assert issued.dictionary.read_text() == "".join(f"{user}:{password}\n" for user, password in pairs)


def test_passwords_are_new_and_links_are_not_followed(folders: Path) -> None:
    issued = issue(robots(folders), folders / "infra")
    before = credentials.read(issued.files["r1"])
    victim = folders / "victim"
    victim.write_text("untouched")
    issued.files["r1"].unlink()
    issued.files["r1"].symlink_to(victim)
    again = issue(robots(folders), folders / "infra")
    assert credentials.read(again.files["r1"]) != before
    assert victim.read_text() == "untouched"


def test_each_robot_has_a_socket_in_its_folder_and_the_others_share_one(folders: Path) -> None:
    issued = issue(robots(folders), folders / "infra")
    assert issued.endpoint("r1") == f"unixsock-stream/{folders}/r1/router.sock"
    config = rules.router_config(issued, ["tcp/127.0.0.1:7447"])
    assert json.loads(config.get_json("listen/endpoints")) == [
        f"unixsock-stream/{folders}/r1/router.new",
        f"unixsock-stream/{folders}/r2/router.new",
        f"unixsock-stream/{folders}/infra/router.new",
        "tcp/127.0.0.1:7447",
    ]


@pytest.mark.parametrize("actor", ["world", "r1"])
def test_sessions_disable_discovery_timestamps_and_shared_memory(actor: str, folders: Path) -> None:
    issued = issue(robots(folders), folders / "infra")
    if actor == "world":
        config = rules.router_config(issued)
    else:
        config = rules.client_config(issued.files[actor], issued.endpoint(actor))
        assert json.loads(config.get_json("mode")) == "client"
        assert json.loads(config.get_json("listen/endpoints")) == []
    for switch in (
        "scouting/multicast/enabled",
        "scouting/gossip/enabled",
        "timestamping/enabled",
        "transport/shared_memory/enabled",
    ):
        assert json.loads(config.get_json(switch)) is False, switch


def test_a_robot_may_use_its_own_keys_only_and_an_observer_may_not_publish() -> None:
    by_id = {rule["id"]: rule for rule in rules.access_rules(["r1"], [])["rules"]}
    assert {
        (name, rule["flows"][0], rule["messages"][0], *rule["key_exprs"]) for name, rule in by_id.items()
    } == {
        ("r1 publishes", "ingress", "put", "swarm/up/r1/**"),
        ("r1 subscribes", "ingress", "declare_subscriber", "swarm/down/r1/**"),
        ("r1 receives", "egress", "put", "swarm/down/r1/**"),
        ("r1 sees subscribers", "egress", "declare_subscriber", "swarm/up/**"),
    }
    given = rules.access_rules([], ["observer"])["rules"]
    assert [(rule["flows"], rule["messages"]) for rule in given] == [
        (["ingress"], ["declare_subscriber"]),
        (["egress"], ["put"]),
    ]
    for topic in TOPICS:
        assert topic.key("r1").startswith(("swarm/up/r1/", "swarm/down/r1/", "swarm/infra/")), topic


@pytest.mark.parametrize("name", ["", "r/1", "*", "r*", "$r", "a:b", "a b", "-r", "r1\n", "é"])
def test_invalid_actor_id_is_rejected(name: str, folders: Path) -> None:
    with refused(
        f"the actor id {name!r} is invalid; use letters, digits, '-' and '_', with a letter or digit first"
    ):
        issue({name: folders / "r1"}, folders / "infra")


def test_duplicate_id_and_too_long_socket_path_are_rejected(folders: Path) -> None:
    with refused("the actor id 'radio' is used twice; ids must be unique"):
        issue({"radio": folders / "r1"}, folders / "infra")
    deep = folders / ("d" * 100)
    deep.mkdir()
    length = len(str(deep / "router.sock"))
    with refused(
        f"the path of the router's socket {deep}/router.sock has {length} bytes; the limit is 107: "
        "choose an output folder with a shorter path"
    ):
        issue({"r1": deep}, folders / "infra")


def test_a_missing_or_broken_credentials_file_is_named(folders: Path) -> None:
    file = folders / "r1" / "credentials"
    with refused(
        f"the credentials file {file} cannot be read: No such file or directory; "
        "it is created at the start of the run"
    ):
        rules.client_config(file, "tcp/127.0.0.1:1")
    file.write_text("r1\n")
    with refused(f"the credentials file {file} must contain one line user:password"):
        rules.client_config(file, "tcp/127.0.0.1:1")
