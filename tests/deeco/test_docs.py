"""The example of docs/deeco.md runs as it stands there, prints what it says, and passes the type check."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from deeco.link import LinkParameters
from deeco.node import CASCADE_LIMIT
from deeco.replication.network import NetworkParameters, RelayParameters

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "deeco.md").read_text()


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 1
    path = tmp_path_factory.mktemp("docs") / "example.py"
    path.write_text(blocks[0])
    return path


def run(example: Path, *command: str) -> str:
    environment = {"PYTHONPATH": str(ROOT), "MYPYPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *command],
        cwd=example.parent,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_example_prints_what_the_page_says(example: Path) -> None:
    printed = run(example, example.name)
    assert f"\nIt prints `{printed.strip()}`.\n" in PAGE


def test_the_example_passes_the_type_check(example: Path) -> None:
    run(example, "-m", "mypy", "--strict", "--config-file=", "--cache-dir=cache", example.name)


def test_the_example_can_be_explained(example: Path) -> None:
    told = run(example, "-m", "deeco.explain", "example")
    assert "switch, a process of the adaptation layer, on a change of is_needed\n" in told


def test_the_numbers_of_the_page_are_those_of_the_code() -> None:
    network, relay = NetworkParameters(), RelayParameters()
    for sentence in (
        f"Every {network.publish_every // 1000} ms, first at",
        f"A replica not heard of for {network.forget_after // 1_000_000} s is dropped",
        f"Of more than {network.most_replicas} the one heard longest ago",
        f"are followed for {CASCADE_LIMIT} rounds",
        f"at most {relay.hop_limit} hops far",
        f"at most {LinkParameters().frame_data} bytes in a frame",
    ):
        assert sentence in " ".join(PAGE.split())
    assert network.relay is None
