"""The container's recipes: what they say, what is understood of such files, and how a tree is entered."""

import os
import re
from pathlib import Path
from typing import Any

import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from benchmarks.container import command
from benchmarks.container.carried import _moved, pip_settings
from benchmarks.container.command import ContainerRow
from benchmarks.container.definition import definition
from benchmarks.container.dockerfile import dockerfile, left_out
from benchmarks.container.recipe import BuildCommand, ContainerRecipe, ContextCopy, RecipeError
from benchmarks.container.tree import DebianTree, TreeEntry
from benchmarks.processors.building import NotBuiltError

RECIPES = command.recipes()


def scripts(recipe: ContainerRecipe) -> str:
    return "\n".join(step.script for step in recipe.steps if isinstance(step, BuildCommand))


def test_both_begin_alike_install_the_same_and_hold_one_commit_ready_to_run() -> None:
    docker, apptainer = RECIPES.values()
    assert docker.base == apptainer.base == "debian:bookworm-slim"
    for recipe in RECIPES.values():
        whole = re.sub(r"\\\n|(?<=\|\|)\n", "", scripts(recipe))
        lines = [" ".join(line.split()) for line in re.split(r"\n|&&", whole)]
        assert [line for line in lines if "apt-get install" in line] == [
            "DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "
            "ca-certificates git python3 python3-venv"
        ]
        assert [line.partition(" || .venv")[0] for line in lines if line.startswith("./acrc")] == [
            "./acrc campaign --on none || ./acrc run --on none",
            "./acrc run --robots 2 --duration 1 --out /tmp/first",
        ]
        assert "git reset --quiet --hard" in lines
        assert [step.target for step in recipe.steps if isinstance(step, ContextCopy)] == ["/opt/acrc/.git"]
    assert (docker.user, docker.entry) == ("acrc", ("/opt/acrc/acrc",))
    assert apptainer.entry[2].strip() == 'exec /opt/acrc/acrc "$@"'


def test_what_remotes_are_and_who_moved_what_stays_outside() -> None:
    kept_back = left_out(REPOSITORY / ".dockerignore")
    assert kept_back == [".git/config", ".git/hooks", ".git/logs"]
    assert f"rm -rf {' '.join(kept_back)}" in scripts(RECIPES["acrc.def"])


def test_no_file_names_where_packages_come_from() -> None:
    for path in (REPOSITORY / "deploy" / "container").iterdir():
        assert not re.search(r"https?://|index-url|find-links|\.(io|com|org)/", path.read_text()), path


DOCKERFILE = """FROM debian:x
ENV A=1 B="two words"
WORKDIR /w
USER ada
COPY --chown=ada a b
RUN one \\
  # why
  two
"""


def test_a_dockerfile_is_its_steps_with_user_folder_and_variables_of_each(tmp_path: Path) -> None:
    path = tmp_path / "Dockerfile"
    path.write_text(DOCKERFILE + 'ENTRYPOINT ["/w/b"]\n')
    variables = {"A": "1", "B": "two words"}
    assert dockerfile(path) == ContainerRecipe(
        "debian:x",
        (
            BuildCommand("mkdir -p /w", "root", "/", {}),
            ContextCopy("a", "/w/b", "ada"),
            BuildCommand("one two", "ada", "/w", variables),
        ),
        ("/w/b",),
        "ada",
        "/w",
        variables,
    )


@pytest.mark.parametrize(
    "line",
    [
        "EXPOSE 8786",
        "FROM debian:y",
        "FROM debian:x AS other",
        'RUN ["one"]',
        "RUN --network=none one",
        "RUN <<EOF",
        "COPY a",
        "COPY --from=other a b",
        "WORKDIR w",
        "USER 1000",
        "ENV A",
        "ENTRYPOINT one",
        "run one",
    ],
)
def test_what_is_not_understood_of_a_dockerfile_is_refused_with_its_line(line: str, tmp_path: Path) -> None:
    path = tmp_path / "Dockerfile"
    path.write_text(f"{DOCKERFILE}{line}\n")
    with pytest.raises(RecipeError) as caught:
        dockerfile(path)
    assert str(caught.value).startswith(f"{path}:9: {line}; must be FROM IMAGE, then RUN COMMAND, ")


def test_a_directive_and_a_missing_entry_point_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "Dockerfile"
    path.write_text(DOCKERFILE)
    with pytest.raises(RecipeError, match="has no ENTRYPOINT; must have one"):
        dockerfile(path)
    path.write_text(f"{DOCKERFILE}RUN one \\\n")
    with pytest.raises(RecipeError, match="RUN one  ends with a backslash; must go on below it"):
        dockerfile(path)
    path.write_text("# syntax=docker/dockerfile:1\n")
    with pytest.raises(RecipeError, match="must be a comment, no directive of the parser"):
        dockerfile(path)


HEADER = "Bootstrap: docker\nFrom: debian:x\n"
RUNSCRIPT = "%runscript\n    exec /w/b\n"


def test_a_definition_is_its_copies_then_its_script(tmp_path: Path) -> None:
    path = tmp_path / "a.def"
    sections = "%files\n  a /w/b\n%post\n  # why\n  one\n  two\n%environment\n  export A='1 2'\n"
    path.write_text(f"# why\n{HEADER}{sections}{RUNSCRIPT}")
    assert definition(path) == ContainerRecipe(
        "debian:x",
        (ContextCopy("a", "/w/b", ""), BuildCommand("set -e\n  one\n  two\n", "root", "/", {})),
        ("/bin/sh", "-c", "    exec /w/b\n", "runscript"),
        environment={"A": "1 2"},
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            f"{HEADER}%setup\n{RUNSCRIPT}",
            ":3: %setup; must be one of %files, %post, %environment, %run",
        ),
        (f"{HEADER}%files from other\n{RUNSCRIPT}", ":3: %files from other; must be one of %files, "),
        (f"{HEADER}Stage: one\n{RUNSCRIPT}", ":3: Stage: one; must be Bootstrap: docker or From: IMAGE"),
        (f"From: debian:x\n{RUNSCRIPT}", ": its header is {'From': 'debian:x'}; must be Bootstrap: docker"),
        (f"{HEADER}%files\n a b\n{RUNSCRIPT}", ": %files: a b; must be SOURCE /TARGET"),
        (f"{HEADER}%files\n a\n{RUNSCRIPT}", ": %files: a; must be SOURCE /TARGET"),
        (f"{HEADER}%environment\n A=1\n{RUNSCRIPT}", ": %environment: A=1; must be export NAME=VALUE"),
        (HEADER, ": has no %runscript; must have one"),
    ],
)
def test_what_is_not_understood_of_a_definition_is_refused(text: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "a.def"
    path.write_text(text)
    with pytest.raises(RecipeError) as caught:
        definition(path)
    assert str(caught.value).startswith(f"{path}{sentence}")


@pytest.mark.parametrize("text", ["", "*\n", "!.git\n*\n", "*\n!.git\n!runs\n", "*\n!.git\n.git/*\n"])
def test_another_dockerignore_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / ".dockerignore").write_text(text)
    with pytest.raises(RecipeError, match=r"must be \*, then !\.git, then names below \.git/"):
        left_out(tmp_path / ".dockerignore")


def test_of_pip_what_concerns_the_way_to_packages_is_carried_and_variables_come_last(tmp_path: Path) -> None:
    (tmp_path / "mirror" / "simple").mkdir(parents=True)
    (tmp_path / "ca.pem").touch()
    listed = (
        f":env:.cert='{tmp_path}/ca.pem'\nglobal.cert='/other'\nglobal.break-system-packages='true'\n"
        f"global.extra-index-url='file://{tmp_path}/mirror/simple https://index.example/simple'\n"
    )
    settings = pip_settings(listed)
    assert set(settings) == {"cert", "extra-index-url"}
    files: dict[Path, Path] = {}
    assert _moved(settings["cert"], files) == "/run/carried/0"
    assert _moved(settings["extra-index-url"], files) == (
        "file:///run/carried/1/simple\nhttps://index.example/simple"
    )
    assert files == {
        Path("/run/carried/0"): tmp_path / "ca.pem",
        Path("/run/carried/1"): tmp_path / "mirror",
    }


def test_a_tree_is_the_root_of_all_files_and_is_left_as_it_was(tmp_path: Path) -> None:
    """With the machine's own programs in place of Debian's; only root may change the root."""
    root = tmp_path / "tree"
    for name in ("proc", "sys", "dev", "usr", "etc", "own"):
        (root / name).mkdir(parents=True)
    for name in ("bin", "sbin", "lib", "lib64"):
        (root / name).symlink_to(f"usr/{name}")
    given = tmp_path / "given"
    given.mkdir(mode=0o777)
    given.chmod(0o777)
    tmp_path.chmod(0o755)
    shown = {Path("/usr"): Path("/usr"), Path("/tmp"): given}
    say = "id -u; pwd; ls /; touch /tmp/left; touch /own/x || echo sealed; echo $A; wc -l </proc/net/route"
    way = TreeEntry("12345", "/own", {"A": "b"}, shown, alone=True, sealed=True)
    done = DebianTree(root).enter(way, ("/bin/sh", "-c", say))
    if os.getuid() != 0:
        assert done.returncode != 0 and not list(given.iterdir())
        return
    folders = ["bin", "dev", "etc", "lib", "lib64", "own", "proc", "sbin", "sys", "tmp", "usr"]
    assert done.stdout.split() == ["12345", "/own", *folders, "sealed", "b", "0"]
    assert [path.name for path in given.iterdir()] == ["left"] and not list((root / "usr").iterdir())
    assert str(root) not in Path("/proc/self/mountinfo").read_text()


def test_the_claim_holds_only_if_digest_commit_and_readiness_are_right(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(command, "software", lambda: "c0")
    right = ContainerRow("a", "d0", "c0", "full", True)
    wrong = [
        ContainerRow("b", "d1", "c0", "full", True),
        ContainerRow("b", "d0", "c1", "full", True),
        ContainerRow("b", "d0", "c0", "full", False),
        ContainerRow("b", fault="apt-get update failed"),
    ]
    for rows, holds in [([right], True), *(([right, one], False) for one in wrong)]:
        monkeypatch.setattr(command, "_built", lambda *_, rows=rows: (rows, "d0"))
        assert command.check().holds is holds


def failing(*_: Any, **__: Any) -> None:
    raise NotBuiltError("debootstrap not found; --install, or: sudo apt install debootstrap")


def test_what_is_missing_is_one_sentence_and_nothing_is_claimed_of_what_was_only_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert command.check(build=False).holds is None
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(command, "provide", failing)
    with pytest.raises(AcrcError) as caught:
        command.check(folder=tmp_path)
    assert str(caught.value) == (
        "acrc verify container: debootstrap not found; --install, or: sudo apt install debootstrap"
    )
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(AcrcError, match="only root can build a tree"):
        command.check(folder=tmp_path)


def test_what_is_not_ready_says_so_in_words_that_are_looked_for() -> None:
    script, kernels = (
        (REPOSITORY / "acrc").read_text(),
        (REPOSITORY / "actors/processes/kernels.py").read_text(),
    )
    installs, compiles = command._FIRST_TIME
    assert f'say "{installs} $((' in script and f'"{compiles} the numeric kernels' in kernels
