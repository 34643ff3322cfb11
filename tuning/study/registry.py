"""Things of one sort by their tags: those of vsajax, of installed packages, and of modules that the user named."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint
from typing import Any, NamedTuple

from tuning.files.errors import input_error
from tuning.study.plugins import (
    Origin,
    Refused,
    Unknown,
    installed,
    load_installed,
    load_named,
    origin_of_point,
    require_consent,
)
from tuning.study.refs import Ref

_LOADED: dict[tuple[str, str], Origin] = {}
"""Where everything foreign that this process has used comes from, by registry and tag."""


class Listed(NamedTuple):
    """One line of a registry's list.

    Args:
        tag: by which a file or a command names it.
        entry: what it is; `None` of one that cannot be used.
        origin: of whom it is; `None`: of vsajax.
        problem: why it cannot be used; empty where it can.
    """

    tag: str
    entry: Any
    origin: Origin | None
    problem: str = ""


class Registry[Entry]:
    """Things of one sort by their tags.

    What vsajax has itself is found first, and nobody can take its tag. For an unknown tag the metadata of
    installed packages are read, and what claims it is imported. `package.module:Name` is imported with consent.

    Args:
        name: of the sort, e.g. "springs"; entry points belong to the group "vsajax.springs".
        own: what vsajax has, by tag.
    """

    def __init__(self, name: str, own: Mapping[str, Entry]):
        self.name = name
        self._own = dict(own)
        self._added: dict[str, Entry] = {}

    def __iter__(self) -> Iterator[str]:
        """Return the tags of all that is here: vsajax' own, then what was added or used so far."""
        return iter([*self._own, *self._added])

    def own(self) -> dict[str, Entry]:
        """Return what vsajax has itself, by tag."""
        return dict(self._own)

    def entries(self) -> dict[str, Entry]:
        """Return all that is here by tag; see `__iter__`."""
        return {**self._own, **self._added}

    def add(self, tag: str, entry: Any, origin: Origin | None = None) -> None:
        """Add something under a tag.

        Raises:
            InputError: the tag is taken, or it is nothing of this sort.
        """
        if tag in self._own or tag in self._added:
            origin = self.origin(tag)
            whose = "vsajax" if origin is None else origin.said
            raise input_error(f"{self.name}: {tag!r}", f"is taken by {whose}", "choose another tag")
        try:
            self._added[tag] = self.fitted(tag, entry, origin)
        except Refused as refused:
            raise input_error(f"{self.name}: {tag!r}", refused.problem, refused.fix) from None
        if origin is not None:
            _LOADED[self.name, tag] = origin

    def fitted(self, tag: str, entry: Any, origin: Origin | None) -> Entry:
        """Return something foreign as this registry holds it.

        Raises:
            Refused: it is nothing of this sort.
        """
        del tag, origin
        return entry

    def find(self, tag: str) -> Entry:
        """Return what a tag stands for.

        Raises:
            Refused: nothing has this tag, or what has it cannot be used; with the way out.
        """
        if tag in self._own:
            return self._own[tag]
        if ":" in tag:
            # Also of what is here already: the consent may have been another command's in this process.
            require_consent(Ref(tag))
        if tag in self._added:
            return self._added[tag]
        if ":" in tag:
            entry, origin = load_named(Ref(tag))
        else:
            points = installed(self.name)
            if tag not in points:
                raise self._unknown(tag, points)
            entry, origin = load_installed(points[tag])
        self._added[tag] = self.fitted(tag, entry, origin)
        _LOADED[self.name, tag] = origin
        return self._added[tag]

    def origin(self, tag: str) -> Origin | None:
        """Return where what has a tag comes from; `None` of what is not foreign, or unused so far."""
        return origin_of(self.name, tag)

    def listed(self) -> Iterator[Listed]:
        """Return all that is here or installed, which is imported; one that fails is listed with the reason."""
        for tag, entry in self._own.items():
            yield Listed(tag, entry, None)
        points = installed(self.name)
        for tag in points:
            if tag in self._own:
                yield Listed(tag, None, origin_of_point(points[tag][0]), "the tag is taken by vsajax")
        for tag in dict.fromkeys([*self._added, *points]):
            if tag not in self._own:
                yield self._listed(tag, points)

    def _listed(self, tag: str, points: Mapping[str, list[EntryPoint]]) -> Listed:
        try:
            return Listed(tag, self.find(tag), self.origin(tag))
        except Refused as refused:
            origin = origin_of_point(points[tag][0]) if tag in points else self.origin(tag)
            return Listed(tag, None, origin, refused.problem)

    def _unknown(self, tag: str, points: Mapping[str, Any]) -> Unknown:
        tags = list(dict.fromkeys([*self, *points]))
        near = difflib.get_close_matches(tag, tags, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        problem = f"got {tag!r}; allowed: {', '.join(map(repr, tags))}"
        return Unknown(problem, f"{hint}`vsajax parts {self.name}` lists them all")


def origin_of(registry: str, tag: str) -> Origin | None:
    """Return where what has a tag in a registry comes from; `None` of what is not foreign, or unused so far."""
    return _LOADED.get((registry, tag))


def origins_of(tag: str) -> list[Origin]:
    """Return where what has a tag, in whichever registry, comes from."""
    return [origin for (_, other), origin in _LOADED.items() if other == tag]
