"""Every command that a page names is one: its words, and each of its options."""

import re
import shlex

import pytest

from deploy.repository import REPOSITORY
from documentation import commands
from documentation.markdown import pages
from documentation.trials import PAGES as PAGES_OF_THEIR_OWN
from documentation.trials import TRIALS, Elsewhere, Reduced, mark, reduced
from documentation.trials import commands as commands_of

PAGES = {page.name: page for page in pages()}
TREE = commands.tree()
ANYTHING = {"…", "...", "COMMAND", "X"}


def fault(text: str) -> str:
    """What is wrong with the words of a command, or ""."""
    words, command, called = shlex.split(text, comments=True)[1:], TREE["acrc"], "acrc"
    while (
        hasattr(command, "commands") and words and words[0] not in ANYTHING and not words[0].startswith("-")
    ):
        called = f"{called} {words.pop(0)}"
        if called not in TREE:
            return f"{called} is no command"
        command = TREE[called]
    if command.context_settings.get("ignore_unknown_options") or command.name == "test":
        return ""
    known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)} | {"--help"}
    options = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    wrong = [option for option in options if option not in known]
    return f"{called} has no {', '.join(wrong)}" if wrong else ""


@pytest.mark.parametrize("name", PAGES)
def test_every_command_of_a_page_exists(name: str) -> None:
    page = PAGES[name]
    typed = [line for block in page.blocks() if block.language == "sh" for line in commands_of(block)]
    said = [*page.codes(), *typed]
    assert [
        f"{one}: {wrong}" for one in said if re.match(r"(\./)?acrc( |$)", one) and (wrong := fault(one))
    ] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("acrc run --robots 4 scenario.toml", ""),
        ("acrc bench failures --robots 4", ""),
        ("acrc bench …", ""),
        ("./acrc run --colour red", "acrc run has no --colour"),
        ("acrc bench everything", "acrc bench everything is no command"),
        ("acrc strategies", "acrc strategies is no command"),
    ],
)
def test_what_is_no_command_is_found(text: str, wrong: str) -> None:
    assert fault(text) == wrong


def test_what_is_tried_otherwise_is_on_a_page_and_has_its_test() -> None:
    typed = {
        line
        for page in PAGES.values()
        for block in page.blocks()
        if block.language == "sh"
        for line in commands_of(block)
    }
    assert sorted(set(TRIALS) - typed) == []
    assert [
        one.test
        for one in TRIALS.values()
        if isinstance(one, Elsewhere) and not (REPOSITORY / one.test).is_file()
    ] == []
    for (page, _), test in PAGES_OF_THEIR_OWN.items():
        assert page.rpartition("/")[2] in (REPOSITORY / test).read_text(), f"{test} does not read {page}"


def test_a_command_at_reduced_size_is_marked_below_its_block() -> None:
    (block,) = PAGES["docs/index.md"].blocks()
    _, second, _ = commands_of(block)
    trial = TRIALS[second]
    assert isinstance(trial, Reduced)
    assert reduced(second) == f"{second} {trial.words}"
    assert mark(block) == f"Tested at reduced size: `{second} {trial.words}`."
