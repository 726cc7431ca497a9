"""Container recipes, executed in a bare Debian tree: a run inside has the digest of one outside.

Requires root, debootstrap and a network, but neither Docker nor Apptainer: the steps are shell scripts.
"""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final

import pytest

from actors.installation.repository import REPOSITORY
from actors.installation.version import software_version
from tests.swarm.command import run

RECIPES: Final = REPOSITORY / "deploy" / "container"
TASK: Final = ("--robots", "2", "--duration", "10")
SETTINGS: Final = ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf")
"""Files of this computer that are mounted in the tree during the build."""
ENTER: Final = """
root=$1 user=$2 context=$3; shift 3
mount --bind "$root" "$root" && cd "$root"
mount -t proc proc proc && mount --rbind /sys sys && mount --rbind /dev dev
for file in $context $SETTINGS; do
    [ -e "$file" ] || continue
    if [ -d "$file" ]; then mkdir -p ".$file"; else mkdir -p ".${file%/*}" && : >>".$file"; fi
    mount --bind "$file" ".$file"
done
mkdir -p .before && pivot_root . .before && umount -l /.before
cd /opt/acrc 2>/dev/null || cd /
group=$(id -g "$user" 2>/dev/null || echo "$user")
exec setpriv --reuid "$user" --regid "$group" --clear-groups env "HOME=/tmp/home-$user" sh -euc "$1"
"""
"""Change the root by pivot_root, since sandboxes do not work in a chroot."""

Steps = list[tuple[str, str]]
"""User and shell script of each step."""
Recipe = Callable[[Path], tuple[Steps, str]]


def dockerfile(context: Path) -> tuple[Steps, str]:
    """Return the steps of the Dockerfile, and the user of its runs."""
    user, steps = "root", Steps()
    for line in (RECIPES / "Dockerfile").read_text().replace("\\\n", " ").splitlines():
        word, _, rest = line.partition(" ")
        match word:
            case "RUN":
                steps.append((user, rest))
            case "COPY":
                owner, source, target = rest.removeprefix("--chown=").split()
                copied = f"cp -a {context}/{source} {target} && chown -R {owner} {target}"
                steps.append(("root", copied))
            case "USER":
                user = rest
            case _:
                assert word in {"", "#", "FROM", "WORKDIR", "ENTRYPOINT"}, line
    return steps, user


def definition(context: Path) -> tuple[Steps, str]:
    """Return the steps of the Apptainer definition, and a user that is unknown in the image."""
    _, *parts = re.split(r"^%(\w+)\n", (RECIPES / "acrc.def").read_text(), flags=re.MULTILINE)
    sections = dict(zip(parts[::2], parts[1::2], strict=True))
    source, target = sections["files"].split()
    copied = f"mkdir -p {Path(target).parent} && cp -a {context}/{source} {target} && chown -R root {target}"
    return [("root", copied), ("root", sections["post"])], "12345"


def enter(
    root: Path, user: str, context: Path, script: str, *, network: bool
) -> "subprocess.CompletedProcess[str]":
    apart = ("unshare", "--mount", "--pid", "--fork", "--kill-child", *(() if network else ("--net",)))
    settings = {"SETTINGS": " ".join(SETTINGS if network else ())}
    return subprocess.run(
        [*apart, "sh", "-euc", ENTER, "sh", str(root), user, str(context), script],
        capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL,
        env={**_environment(), **settings},
    )  # fmt: skip


def _environment() -> Mapping[str, str]:
    kept = {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "http"))}
    return {**kept, "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}


@pytest.fixture(scope="module")
def debian(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    if os.geteuid() or shutil.which("debootstrap") is None:
        pytest.skip("needs root and debootstrap")
    tree = tmp_path_factory.mktemp("debian") / "bookworm"
    subprocess.run(["debootstrap", "--variant=minbase", "bookworm", tree], check=True, capture_output=True)
    yield tree
    shutil.rmtree(tree)


@pytest.mark.parametrize("recipe", [dockerfile, definition])
def test_the_recipes_are_parsed(recipe: Recipe) -> None:
    steps, user = recipe(Path("/context"))
    assert user in {"acrc", "12345"} and any("git reset --quiet --hard" in script for _, script in steps)


@pytest.mark.claim("container")
@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("recipe", [dockerfile, definition])
def test_a_run_in_the_container_has_the_digest_of_one_outside(
    recipe: Recipe, debian: Path, tmp_path: Path
) -> None:
    context = tmp_path / "context"
    subprocess.run(["git", "clone", "-q", "--no-checkout", REPOSITORY, context], check=True)
    shutil.rmtree(context / ".git" / "hooks")
    tree = tmp_path / "tree"
    subprocess.run(["cp", "-a", debian, tree], check=True)
    steps, user = recipe(context)
    for owner, script in steps:
        done = enter(tree, owner, context, script, network=True)
        assert done.returncode == 0, (script, done.stderr)
    words = f"/opt/acrc/acrc run {' '.join(TASK)} --out /tmp/out --json"
    done = enter(tree, user, context, words, network=False)
    assert done.returncode == 0, done.stderr
    assert not re.search("installing|compiling", done.stderr)
    inside = json.loads(done.stdout)
    outside = run(tmp_path / "out", *TASK)
    assert (inside["digest"], inside["origin"]["commit"]) == (
        outside["digest"],
        software_version().removesuffix("+"),
    )
