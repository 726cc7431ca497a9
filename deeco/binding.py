"""Finds, for every parameter of a process or an ensemble, what the node has of that type."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from deeco.ensemble import Contact
from deeco.errors import DeploymentError
from deeco.immutability import describe
from deeco.instant import Instant

_NOW: Final = object()
_CONTACT: Final = object()


class Binding:
    """What a node provides, by type; beside it Instant, which is now, and in ensembles Contact."""

    def __init__(self, provided: Mapping[Any, object]) -> None:
        self._provided = dict(provided)

    def process(
        self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str
    ) -> Callable[[Any, Instant], Any]:
        """The process as a function of knowledge and instant. Raises DeploymentError if a port is missing."""
        arguments = tuple(self._argument(port, name, contact=False) for port in ports)
        if not arguments:
            return lambda knowledge, now: function(knowledge)
        if _NOW not in arguments:
            return lambda knowledge, now: function(knowledge, *arguments)
        *others, last = arguments
        if last is _NOW and _NOW not in others:
            return lambda knowledge, now: function(knowledge, *others, now)
        return lambda knowledge, now: function(knowledge, *(now if a is _NOW else a for a in arguments))

    def pair(
        self, function: Callable[..., Any], ports: tuple[tuple[str, Any], ...], name: str
    ) -> Callable[[Any, Any, Instant, Contact], Any]:
        """An ensemble's method as a function of coordinator, member, instant and contact to the peer."""
        arguments = tuple(self._argument(port, name, contact=True) for port in ports)
        if not arguments:
            return lambda coordinator, member, now, contact: function(coordinator, member)
        if arguments == (_NOW,):
            return lambda coordinator, member, now, contact: function(coordinator, member, now)
        return lambda coordinator, member, now, contact: function(
            coordinator, member, *(now if a is _NOW else contact if a is _CONTACT else a for a in arguments)
        )

    def _argument(self, port: tuple[str, Any], name: str, *, contact: bool) -> object:
        parameter, kind = port
        if kind in self._provided:
            return self._provided[kind]
        if kind is Instant:
            return _NOW
        if contact and kind is Contact:
            return _CONTACT
        there = ", ".join(describe(one) for one in self._provided) or "nothing"
        raise DeploymentError(f"{name} needs a {describe(kind)} ({parameter!r}); this node provides {there}")
