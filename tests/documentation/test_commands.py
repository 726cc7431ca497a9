"""Every command that a page names is one: its words, and each of its options."""

import re
import shlex

import pytest

from actors.installation.repository import REPOSITORY
from command_line.documentation import commands
from command_line.documentation.markdown import Block, pages
from command_line.documentation.trials import PAGES as PAGES_OF_THEIR_OWN
from command_line.documentation.trials import SHORTENED, TYPED_ELSEWHERE, Command, mark, shortened
from command_line.documentation.trials import commands as commands_of
from experiments.comparison.metrics import NAMES

PAGES = {page.name: page for page in pages()}
TREE = commands.tree()
ANYTHING = {"…", "...", "COMMAND", "X"}
REASONS = {
    *(
        "goes on until Ctrl-C",
        "in the other terminal",
        "it is what runs them",
        "it is one of the checks",
        "makes 240 runs",
    ),
    *(
        "makes 75 runs",
        "makes 1280 runs",
        "makes many runs",
        "wants these runs",
        "wants software without changes",
        "ends with exit code 1",
        "opens a window",
        "wants the 240 runs",
        "wants the 75 runs",
        "wants the 1280 runs",
        "tests/floor/test_offices.py calls the script",
    ),
    *("wants a TurtleBot", "wants a browser", "wants a network", "wants a run that goes on"),
    *("wants folders of yours", "wants somebody to talk to", "wants two terminals"),
    *("wants a cluster", "wants hosts with ssh", "wants Slurm", "wants Kubernetes"),
    *("wants Docker", "wants Apptainer"),
}


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
    typed = [line for block in page.blocks() if block.language == "sh" for line, _ in commands_of(block)]
    said = [*page.codes(), *typed]
    assert [
        f"{one}: {wrong}" for one in said if re.match(r"(\./)?acrc( |$)", one) and (wrong := fault(one))
    ] == []


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("acrc run --robots 4 scenario.toml", ""),
        ("acrc verify failures --robots 4", ""),
        ("acrc bench …", ""),
        ("./acrc run --colour red", "acrc run has no --colour"),
        ("acrc record everything", "acrc record everything is no command"),
        ("acrc strategies", "acrc strategies is no command"),
    ],
)
def test_what_is_no_command_is_found(text: str, wrong: str) -> None:
    assert fault(text) == wrong


TYPED = {
    command
    for page in PAGES.values()
    for block in page.blocks()
    if block.language == "sh"
    for command in commands_of(block)
}


def test_what_is_shortened_is_on_a_page_and_run() -> None:
    assert sorted(set(SHORTENED) - {command.words for command in TYPED if not command.untried}) == []
    for (page, _), test in PAGES_OF_THEIR_OWN.items():
        assert page.rpartition("/")[2] in (REPOSITORY / test).read_text(), f"{test} does not read {page}"


def test_what_is_typed_elsewhere_is_on_a_page_and_in_its_test() -> None:
    for words, test in TYPED_ELSEWHERE.items():
        assert Command(words, "") in TYPED and words in (REPOSITORY / test).read_text()


def test_a_command_is_left_out_only_where_the_page_says_so_beside_it() -> None:
    text = "./acrc demo   # one # picture\n./acrc test  # ours (not run by tests: it runs them)\n"
    text += "./acrc view X \\\n  --png # (not run by tests)\n\n# only said\n"
    block = Block("sh", text, 1)
    assert commands_of(block) == [
        Command("./acrc demo", ""),
        Command("./acrc test", "it runs them"),
        Command("./acrc view X    --png", ""),
    ]


def test_the_pages_leave_out_what_cannot_be_run_and_nothing_else() -> None:
    """For review: each reason that a page gives; a command without one is run (test_blocks)."""
    reasons = {command.untried for command in TYPED if command.untried}
    assert reasons == REASONS


def test_a_command_at_reduced_size_is_marked_below_its_block() -> None:
    (block,) = PAGES["docs/index.md"].blocks()
    whole, *short = commands_of(block)
    assert shortened(whole) == whole.words
    assert [shortened(one) for one in short] == [f"{one.words} --duration 5" for one in short]
    assert mark(block) == " ".join(f"Tested at reduced size: `{one.words} --duration 5`." for one in short)


def test_the_reference_of_commands_is_of_these_commands() -> None:
    page = REPOSITORY / "docs" / "reference" / "commands.md"
    assert page.read_text() == commands.as_markdown(), "`./acrc docs` makes it anew"


def test_the_help_of_compare_names_what_it_compares() -> None:
    (option,) = (one for one in TREE["acrc compare"].params if "--metric" in one.opts)
    assert set(re.findall(r"\w+", option.help.partition(":")[2].partition(";")[0])) == set(NAMES)
