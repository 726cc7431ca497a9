"""`python -m deeco.explain`: describe components and ensembles from their source."""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Final

from deeco.ensemble import ensemble_type
from deeco.errors import DeecoError
from deeco.explain.description import component_text, ensemble_text, field_table, mermaid_chart, names
from deeco.explain.knowledge_use import ComponentPart, ensemble_part, mode_part, processes
from deeco.knowledge import Knowledge, is_component, is_role

_FORM: Final = "'module:Component', 'module:Ensemble' or 'module'"


class UnexplainableError(DeecoError):
    """An argument that is not a component or an ensemble."""


@dataclass
class Subjects:
    """The classes to describe; dicts serve as ordered sets."""

    components: dict[type[Knowledge], None] = field(default_factory=dict)
    ensembles: dict[type, object] = field(default_factory=dict)
    """By class: the class or, if one was named, the instance."""

    def add(self, subject: object) -> bool:
        """Add a component class, an ensemble class or an ensemble; return False for anything else."""
        cls = subject if isinstance(subject, type) else type(subject)
        if cls is subject and is_component(cls):
            self.components[cls] = None
        elif ensemble_type(cls):
            self.ensembles.setdefault(cls, subject)
        else:
            return False
        return True

    def parts(self, cls: type[Knowledge]) -> tuple[ComponentPart, ...]:
        """Return the processes of a component, its modes, then the ensembles that it takes part in."""
        parts = (mode_part(cls), *(ensemble_part(ensemble, cls) for ensemble in self.ensembles))
        return processes(cls) + tuple(part for part in parts if part)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the descriptions; return 2 if an argument is wrong."""
    parser = argparse.ArgumentParser(
        prog="python -m deeco.explain",
        description="Show when the processes of a component and its ensembles run and which fields they read "
        "and write, or draw the adapted and the adaptation layer.",
        epilog="Example: python -m deeco.explain examples.convoy:Follower examples.convoy:Convoy",
    )
    parser.add_argument("subject", nargs="+", help=f"{_FORM}; of a module all it defines or else imports")
    parser.add_argument("--mermaid", action="store_true", help="print a Mermaid flowchart of both layers")
    options = parser.parse_args(arguments)
    try:
        subjects = find(options.subject)
    except DeecoError as error:
        print(f"deeco.explain: {error}", file=sys.stderr)  # noqa: T201
        return 2
    if options.mermaid:
        lines = mermaid_chart({cls: subjects.parts(cls) for cls in subjects.components})
    else:
        lines = text(subjects)
    try:
        print("\n".join(lines), flush=True)  # noqa: T201
    except BrokenPipeError:  # the reader, such as `head`, has exited
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def text(subjects: Subjects) -> list[str]:
    """Describe all components and ensembles, then the use of each component's fields."""
    sections = [component_text(cls, processes(cls)) for cls in subjects.components]
    sections += [ensemble_text(cls, subject) for cls, subject in subjects.ensembles.items()]
    sections += [field_table(cls, subjects.parts(cls)) for cls in subjects.components]
    return [line for section in sections for line in (*section, "", "")][:-2]


def find(arguments: Sequence[str]) -> Subjects:
    """Return the subjects that the arguments name. Raises UnexplainableError."""
    subjects = Subjects()
    for argument in arguments:
        module_name, colon, name = argument.partition(":")
        if not module_name or module_name.startswith(".") or (colon and not name):
            raise UnexplainableError(f"{argument!r} is not a valid name; write {_FORM}")
        module = _module(module_name)
        if not colon:
            found, _ = _defined(module)
            if not found:
                raise UnexplainableError(f"{_available(module)}; name another module, or one of its classes")
            for one in found:
                subjects.add(one)
        elif not hasattr(module, name):
            raise UnexplainableError(f"{module_name} does not define {name!r}; {_available(module)}")
        elif not subjects.add(getattr(module, name)):
            raise UnexplainableError(f"{argument} is {_kind(getattr(module, name))}; {_available(module)}")
    return subjects


def _module(name: str) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if name == missing or name.startswith(f"{missing}."):
            raise UnexplainableError(
                f"module {name!r} not found; write it as in an import, "
                "such as examples.convoy, and start in the folder that contains it"
            ) from None
        raise UnexplainableError(
            f"module {name!r} cannot be imported: {missing!r} is not installed"
        ) from None


def _defined(module: ModuleType) -> tuple[list[type], str]:
    """Return the components, then the ensembles, that a module defines or else imports, with that verb."""
    classes = dict.fromkeys(one for one in vars(module).values() if isinstance(one, type))
    found = [one for one in classes if is_component(one)] + [one for one in classes if ensemble_type(one)]
    own = [one for one in found if one.__module__ == module.__name__]
    return own or found, "defines" if own else "imports"


def _available(module: ModuleType) -> str:
    found, verb = _defined(module)
    if not found:
        return f"{module.__name__} has no class with @component or @ensemble"
    return f"{module.__name__} {verb} {names(one.__name__ for one in found)}"


def _kind(found: object) -> str:
    if isinstance(found, type):
        return (
            "a role; name a component or an ensemble"
            if is_role(found)
            else "a class without @component and @ensemble"
        )
    if is_component(type(found)):
        return f"an instance of the component {type(found).__name__}; name its class"
    return f"of type {type(found).__name__}, neither a component nor an ensemble"
