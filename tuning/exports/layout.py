"""How the numbers of a step are laid out: trees of named fields, with shape, unit and meaning.

Names, units and meanings are read from the classes of vsajax, from their fields and the `Args:` of their
docstrings: nothing here is a second list to keep.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, ForwardRef, Literal

import jax
import numpy as np

Path = tuple[str | int, ...]
Kind = Literal["real", "bool", "int"]
_KINDS: dict[str, Kind] = {"b": "bool", "i": "int", "u": "int"}
_UNIT = re.compile(r"\[([^\]]*)\]")
_ENTRY = re.compile(r"    (\w+): (.*)")


@dataclass(frozen=True)
class Leaf:
    """A number or an array of numbers.

    Args:
        shape: its dimensions; () for a number.
        kind: of its elements.
        unit: SI, e.g. "N·m/rad"; "" where none is stated.
        meaning: a phrase.
        is_sum: whether it adds up over all samples, a `vsajax.types.RunningSum`.
    """

    shape: tuple[int, ...]
    kind: Kind
    unit: str = ""
    meaning: str = ""
    is_sum: bool = False


@dataclass(frozen=True)
class Repeated:
    """Several of one kind, one behind the other."""

    count: int
    of: Field


@dataclass(frozen=True)
class Record:
    """Named fields.

    Args:
        name: of the class that it mirrors, in snake case.
        meaning: a phrase.
        fields: in order.
    """

    name: str
    meaning: str
    fields: dict[str, Field]


Field = Leaf | Repeated | Record


def leaves(field: Field, path: Path = ()) -> Iterator[tuple[Path, Leaf]]:
    """Yield every leaf with its path, in the order in which jax flattens the tree that was described."""
    if isinstance(field, Leaf):
        yield path, field
    elif isinstance(field, Repeated):
        for i in range(field.count):
            yield from leaves(field.of, (*path, i))
    else:
        for name, inner in field.fields.items():
            yield from leaves(inner, (*path, name))


def dotted(path: Path) -> str:
    """Return a path for people, e.g. ``fit.covariance[3]``."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).removeprefix(".")


def describe(tree: Any, *, unit: str = "", meaning: str = "") -> Field | None:
    """Return the layout of a tree of arrays; `None` where it has none.

    Args:
        tree: modules, named tuples and tuples of arrays, or of their shapes.
        unit: of a leaf.
        meaning: of a leaf.
    """
    if tree is None:
        return None
    if hasattr(tree, "shape"):
        return Leaf(tuple(tree.shape), _KINDS.get(np.dtype(tree.dtype).kind, "real"), unit, meaning)
    if hasattr(tree, "_fields"):
        return _record(type(tree), {name: getattr(tree, name) for name in tree._fields})
    if isinstance(tree, tuple | list):
        return _sequence([describe(item, unit=unit, meaning=meaning) for item in tree])
    if dataclasses.is_dataclass(tree):
        names = [f.name for f in dataclasses.fields(tree) if not f.metadata.get("static", False)]
        return _record(type(tree), {name: getattr(tree, name) for name in names})
    return None


def _sequence(items: list[Field | None]) -> Field | None:
    found = [item for item in items if item is not None]
    if not found:
        return None
    if len(set(map(repr, found))) > 1:
        return Record("parts", "", {f"part{i + 1}": item for i, item in enumerate(found)})
    first = found[0]
    if isinstance(first, Leaf):
        return dataclasses.replace(first, shape=(len(found), *first.shape))
    return Repeated(len(found), first)


def _record(cls: type, values: dict[str, Any]) -> Field | None:
    explained = told(cls)
    fields = {}
    for name, value in values.items():
        meaning, unit = explained.get(name, ("", ""))
        meaning = meaning or (name.replace("_", " ") if unit else "")
        field = describe(value, unit=unit, meaning=meaning)
        if isinstance(field, Leaf) and _is_sum(cls, name):
            field = dataclasses.replace(field, is_sum=True)
        if field is not None:
            fields[name] = field
    summary = (inspect.getdoc(cls) or "").partition("\n\n")[0].replace("\n", " ")
    return Record(snake(cls.__name__), summary, fields) if fields else None


def _is_sum(cls: type, name: str) -> bool:
    """Return whether a class declares a field as a sum; annotations are text where they are not evaluated."""
    declared = cls.__annotations__.get(name)
    return isinstance(declared, str | ForwardRef) and "RunningSum" in str(declared)


@cache
def told(cls: type) -> dict[str, tuple[str, str]]:
    """Return meaning and unit of every argument that a class' docstring explains."""
    found: dict[str, list[str]] = {}
    _, _, text = (inspect.getdoc(cls) or "").partition("Args:\n")
    name = ""
    for line in text.splitlines():
        entry = _ENTRY.fullmatch(line)
        if entry:
            name = entry[1]
            found[name] = [entry[2]]
        elif name and line.startswith("     "):
            found[name].append(line.strip())
        else:
            name = ""
    explained = {}
    for name, lines in found.items():
        meaning = " ".join(lines).removesuffix(".")
        unit = _UNIT.search(meaning)
        has_one = unit is not None and not re.search(r"[,( ]", unit[1])
        explained[name] = (
            " ".join(meaning.replace(unit[0], "").split()).replace(" ;", ";").replace(" ,", ",").lstrip("; ")
            if unit and has_one
            else meaning,
            unit[1] if unit and has_one else "",
        )
    return explained


def snake(name: str) -> str:
    """Return a class' name in snake case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def select(field: Field, keep: frozenset[Path], path: Path = ()) -> Field | None:
    """Return the layout with only the leaves at some paths, and no record left empty."""
    if isinstance(field, Record):
        fields = {name: select(inner, keep, (*path, name)) for name, inner in field.fields.items()}
        kept = {name: inner for name, inner in fields.items() if inner is not None}
        return dataclasses.replace(field, fields=kept) if kept else None
    return field if any(place in keep for place, _ in leaves(field, path)) else None


def elements(tree: Any, field: Field) -> list[tuple[Path, Leaf]]:
    """Return for every array of a tree, in jax' order, where it lies in its layout.

    A tuple of numbers is one leaf of the layout: its items lie at ``(…, i)`` and have the shape of what is left.
    """
    arrays = jax.tree.leaves(tree)
    places: list[tuple[Path, Leaf]] = []
    for path, leaf in leaves(field):
        here = arrays[len(places)]
        missing = len(leaf.shape) - len(here.shape)
        item = dataclasses.replace(leaf, shape=leaf.shape[missing:])
        places += [((*path, *index), item) for index in np.ndindex(*leaf.shape[:missing])]
    if len(places) != len(arrays):
        raise ValueError(f"the layout has {len(places)} arrays, the tree {len(arrays)}")
    return places
