"""Where something is defined, by name: it is imported when it is asked for."""

from __future__ import annotations

import re
from importlib import import_module
from typing import Any, NamedTuple

_FORM = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")


class Ref(str):
    """Where something is defined, `package.module:name`; it is imported when it is loaded."""

    __slots__ = ()

    @property
    def module(self) -> str:
        """The module that defines it."""
        return self.partition(":")[0]

    @property
    def name(self) -> str:
        """Its name there."""
        return self.partition(":")[2]

    @property
    def is_whole(self) -> bool:
        """Whether it is of that form."""
        return _FORM.fullmatch(self) is not None

    def load(self) -> Any:
        """Return what is defined there."""
        return getattr(import_module(self.module), self.name)


class Explained(NamedTuple):
    """Where something is defined, and what it is, for lists in which it is not imported.

    Args:
        ref: where.
        summary: in a line.
    """

    ref: Ref
    summary: str
