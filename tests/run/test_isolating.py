"""Robots that are not shut off are never a surprise: the terminal says so, and why."""

import pytest

from actors.runtime.isolation import container, sandbox
from actors.runtime.isolation.isolating import OPEN, IsolationChoice, choose, warn
from tests.swarm.command import acrc

REASON = f"this machine has no locks; {container.advice()}"


@pytest.fixture
def unable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "available", lambda: REASON)


def test_where_it_can_be_had_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sandbox, "available", lambda: None)
    assert choose(None) == choose(True) == IsolationChoice(True, "")


@pytest.mark.usefixtures("unable")
def test_the_default_falls_back_with_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(container, "kind", lambda: "")
    monkeypatch.setattr(sandbox, "available", lambda: f"this machine has no locks; {container.advice()}")
    assert choose(None) == IsolationChoice(
        False, f"robots run as plain processes, because this machine has no locks; {OPEN}"
    )


@pytest.mark.usefixtures("unable")
def test_what_was_asked_for_does_not_fall_back() -> None:
    with pytest.raises(sandbox.IsolationError) as caught:
        choose(True)
    assert str(caught.value) == REASON


def test_who_does_without_is_told_what_that_means(capsys: pytest.CaptureFixture[str]) -> None:
    choice = choose(False)
    assert choice == IsolationChoice(False, f"--no-isolate: robots run as plain processes; {OPEN}")
    assert choose(None, debugged=True).warning == f"--debugpy: robots run as plain processes; {OPEN}"
    warn(choice.warning)
    warn("")
    assert capsys.readouterr() == (
        "",
        "acrc: --no-isolate: robots run as plain processes; each can read the others' passwords, files and "
        "memory, and reach them past the radio; a strategy that is not out to cheat gives the same result\n",
    )


def test_the_command_says_it(tmp_path: object) -> None:
    done = acrc("run", "--no-isolate", "--robots", 1, "--duration", 1, "--json", "--out", f"{tmp_path}/out")
    assert done.returncode == 0
    assert f"acrc: --no-isolate: robots run as plain processes; {OPEN}" in done.stderr
