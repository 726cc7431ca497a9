"""A component on its node: its present knowledge, its processes, and the facts that are watched in it."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from deeco.binding import Binding
from deeco.ensemble import Contact
from deeco.errors import DeploymentError, ExecutionError
from deeco.instant import Instant, in_seconds
from deeco.knowledge import Knowledge, is_component, is_role, seen_as
from deeco.process import Fact, OnChange, Periodic, Process, processes_of
from deeco.replacing import made as named


class Commit(NamedTuple):
    """A change of a component's knowledge, for whoever looks on."""

    by: str
    """The process or the ensemble's exchange, as in `Cleaner.sense` or `Adoption.at_member`."""
    instant: Instant
    before: Knowledge
    after: Knowledge
    adaptation: bool
    """True of an ensemble, and of a process of the adaptation layer."""
    peer: str = ""
    """The component whose knowledge an ensemble used; empty for a process."""
    heard: Instant | None = None
    """When that knowledge had come here."""


Witness = Callable[[Commit], None]


class BoundProcess:
    """One process of one component, with its ports."""

    def __init__(self, process: Process, component: "LocalComponent", binding: Binding) -> None:
        self.name = str(process)
        self.schedule = process.schedule
        self._adaptation = process.adaptation
        self._component = component
        function = getattr(type(component.value), process.name)
        self._call = binding.process(function, process.ports, self.name)

    def run(self, now: Instant) -> bool:
        """Call the process and commit what it gives; True if that is new knowledge."""
        component = self._component
        try:
            made = self._call(component.value, now)
        except Exception as error:
            error.add_note(f"in process {self.name} of {component.id!r} at {in_seconds(now):g} s")
            raise
        if made is component.value:
            return False
        return component.commit(made, self.name, now, adaptation=self._adaptation)


class LocalComponent:
    """Holds the knowledge of one component; every change of it goes through `commit`.

    `witness` is told of each, once it has been made, and changes nothing.
    """

    def __init__(self, value: Knowledge, binding: Binding, witness: Witness | None = None) -> None:
        kind = type(value)
        if not is_component(kind):
            raise DeploymentError(f"{kind.__name__} cannot be deployed; its class should have @component")
        self.id = value.id
        self.value = value
        self.processes = tuple(BoundProcess(process, self, binding) for process in processes_of(kind))
        self._witness = witness
        self.watched: list[tuple[str, Callable[[], str]]] = []
        """Facts that somebody watches here, by name, and whom to call."""
        self._facts: list[object] = []
        self._seen: dict[type[Knowledge], tuple[Knowledge, Knowledge]] = {}

    @property
    def periodic(self) -> tuple[tuple[BoundProcess, Periodic], ...]:
        """The processes that run by the clock."""
        return tuple((one, one.schedule) for one in self.processes if isinstance(one.schedule, Periodic))

    @property
    def triggered(self) -> tuple[tuple[BoundProcess, OnChange], ...]:
        """The processes that run on a change."""
        return tuple((one, one.schedule) for one in self.processes if isinstance(one.schedule, OnChange))

    def watch(self, facts: Sequence[Fact], then: Callable[[], str]) -> None:
        """Call `then` from `changes` whenever one of the facts has another value than at the call before."""
        for fact in facts:
            self.watched.append((fact.__name__, then))
            self._facts.append(getattr(self.value, fact.__name__)())

    def changes(self) -> list[Callable[[], str]]:
        """Whom to call because a fact has changed since the last call of this, each once, in order."""
        called: dict[Callable[[], str], None] = {}
        for index, (name, then) in enumerate(self.watched):
            fact = getattr(self.value, name)()
            if fact != self._facts[index]:
                self._facts[index] = fact
                called[then] = None
        return list(called)

    def commit(
        self,
        made: Any,
        by: str,
        now: Instant,
        *,
        adaptation: bool = False,
        peer: str = "",
        heard: Instant | None = None,
    ) -> bool:
        """Take over new knowledge; True if it differs. Raises ExecutionError for anything else."""
        value = self.value
        if type(made) is not type(value):
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s gives a {type(made).__name__}; "
                f"it should give the next {type(value).__name__}"
            )
        if made == value:
            return False
        if made.id != self.id:
            raise ExecutionError(
                f"{by} of {self.id!r} at {in_seconds(now):g} s changes the id to {made.id!r}; it should stay"
            )
        self.value = made
        if self._witness is not None:
            self._witness(named(Commit, (by, now, value, made, adaptation, peer, heard)))
        return True

    def role(self, kind: type[Knowledge]) -> Any:
        """What a peer on the same node sees: the role only; None if it is not played."""
        if not is_role(kind) or not isinstance(self.value, kind):
            return None
        seen = self._seen.get(kind)
        if seen is None or seen[0] is not self.value:
            seen = self._seen[kind] = (self.value, seen_as(self.value, kind))
        return seen[1]

    def contact(self, now: Instant) -> Contact:
        """As close as can be."""
        return Contact(now, None, 0)
