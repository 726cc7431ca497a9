"""`python -m deeco.explain`: what a component and its ensembles do, told and drawn from their source."""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Final

from deeco.errors import DeecoError
from deeco.explain.anatomy import ComponentPart, ensemble_type, meeting, processes
from deeco.explain.description import (
    component_text,
    ensemble_text,
    mermaid_drawing,
    names,
    table,
    text_drawing,
)
from deeco.knowledge import Knowledge, is_component, is_role

_FORM: Final = "'module:Component', 'module:Ensemble' or 'module'"


class UnexplainableError(DeecoError):
    """An argument that names nothing that can be explained."""


@dataclass
class Subjects:
    """What is to be explained."""

    components: list[type[Knowledge]] = field(default_factory=list)
    ensembles: list[tuple[type, object | None]] = field(default_factory=list)
    """Each a class, and an instance if one was named."""

    def add(self, found: object) -> bool:
        """Take in a component's class, an ensemble's class or an ensemble; false for anything else."""
        cls = found if isinstance(found, type) else type(found)
        if isinstance(found, type) and is_component(found):
            if found not in self.components:
                self.components.append(found)
            return True
        if ensemble_type(cls) is None:
            return False
        if all(cls is not known for known, _ in self.ensembles):
            self.ensembles.append((cls, None if found is cls else found))
        return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Print explanations; 2 if an argument is wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m deeco.explain",
        description="Say when the processes of a component and its ensembles run, what they read and write, "
        "and draw the adapted and the adaptation layer.",
        epilog="Example: python -m deeco.explain examples.convoy:Follower examples.convoy:Convoy",
    )
    parser.add_argument("subject", nargs="+", help=f"{_FORM}: all that it defines, or else imports")
    parser.add_argument(
        "--mermaid", action="store_true", help="print the drawing only, as a Mermaid flowchart"
    )
    options = parser.parse_args(arguments)
    try:
        subjects = find(options.subject)
    except DeecoError as error:
        print(f"deeco.explain: {error}", file=sys.stderr)  # noqa: T201
        return 2
    try:
        print("\n".join(mermaid(subjects) if options.mermaid else text(subjects)), flush=True)  # noqa: T201
    except BrokenPipeError:  # whoever reads it has had enough, as `head` has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def text(subjects: Subjects) -> list[str]:
    """Everything in words, with a table and a drawing for each component."""
    lines: list[str] = []
    for cls in subjects.components:
        lines += [*component_text(cls, processes(cls)), "", ""]
    for ensemble, instance in subjects.ensembles:
        lines += [*ensemble_text(ensemble, instance), "", ""]
    for cls in subjects.components:
        parts = parts_of(cls, subjects)
        lines += [*table(cls, parts), "", f"{cls.__name__}, its layers", *text_drawing(parts), "", ""]
    return lines[:-2]


def mermaid(subjects: Subjects) -> list[str]:
    """All components in one flowchart."""
    return mermaid_drawing([(cls.__name__, parts_of(cls, subjects)) for cls in subjects.components])


def parts_of(cls: type[Knowledge], subjects: Subjects) -> tuple[ComponentPart, ...]:
    """The processes of a component, and the ensembles that it meets."""
    met = (meeting(ensemble, cls) for ensemble, _ in subjects.ensembles)
    return processes(cls) + tuple(part for part in met if part)


def find(arguments: Sequence[str]) -> Subjects:
    """What the arguments name. Raises ArgumentError with what would have been right."""
    subjects = Subjects()
    for argument in arguments:
        module_name, colon, name = argument.partition(":")
        if not module_name or module_name.startswith(".") or (colon and not name):
            raise UnexplainableError(f"{argument!r} names nothing; it should be {_FORM}")
        module = _module(module_name)
        if not colon:
            _add_all(module, subjects)
        elif not hasattr(module, name):
            raise UnexplainableError(f"there is no {name!r} in {module_name}; {_offer(module)}")
        elif not subjects.add(getattr(module, name)):
            raise UnexplainableError(f"{argument} is {_what(getattr(module, name))}; {_offer(module)}")
    return subjects


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if name == missing or name.startswith(f"{missing}."):
            raise UnexplainableError(
                f"there is no module {name!r} here; it should be written as in an import, "
                "such as examples.convoy, and be found from the current folder"
            ) from None
        raise UnexplainableError(
            f"the module {name!r} cannot be imported, for it needs {missing!r}, which is not installed"
        ) from None


def _subjects(module: ModuleType) -> tuple[list[type], list[type], str]:
    """Return the component and ensemble classes that a module defines, or else imports; and which."""
    classes = list(dict.fromkeys(one for one in vars(module).values() if isinstance(one, type)))
    found = [one for one in classes if is_component(one) or ensemble_type(one)]
    own = [one for one in found if one.__module__ == module.__name__]
    chosen = own or found
    components = [one for one in chosen if is_component(one)]
    return components, [one for one in chosen if ensemble_type(one)], "defines" if own else "imports"


def _add_all(module: ModuleType, subjects: Subjects) -> None:
    components, ensembles, _ = _subjects(module)
    if not components and not ensembles:
        raise UnexplainableError(f"{_offer(module)}; name another module, or one of its classes")
    for one in (*components, *ensembles):
        subjects.add(one)


def _offer(module: ModuleType) -> str:
    components, ensembles, verb = _subjects(module)
    if not components and not ensembles:
        return f"{module.__name__} has no class with @component or @ensemble"
    found = names(one.__name__ for one in (*components, *ensembles))
    return f"{module.__name__} {verb} {found}"


def _what(found: object) -> str:
    if isinstance(found, type) and is_role(found):
        return "a role, which by itself does nothing"
    if isinstance(found, type):
        return "a class without @component and @ensemble"
    if is_component(type(found)):
        return f"an instance of the component {type(found).__name__}, whose class should be named"
    return f"of type {type(found).__name__}, neither a component nor an ensemble"
