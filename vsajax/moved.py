"""Old names of what has moved: they go on working for one release, and warn of the new ones."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Mapping
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType
from typing import Any


class _OldModules(MetaPathFinder, Loader):
    """Makes a module of an old name that hands out what the module of the new one has."""

    def __init__(self, moved: Mapping[str, str]) -> None:
        self.moved = moved

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        del path, target
        return spec_from_loader(fullname, self) if fullname in self.moved else None

    def exec_module(self, module: ModuleType) -> None:
        new = self.moved[module.__name__]
        _warn(module.__name__, new)
        vars(module)["__getattr__"] = lambda name: getattr(importlib.import_module(new), name)


def keep_modules(moved: Mapping[str, str]) -> None:
    """Let modules be imported under their old names.

    Args:
        moved: the new full name by the old one.
    """
    sys.meta_path.append(_OldModules(moved))


def old_names(module: str, moved: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a module whose names have moved.

    Args:
        module: full name of that module.
        moved: by name, the full name of the module that now has it, `module:name` if it has another name there;
            or the full name of a module, by its own old name.
    """

    def find(name: str) -> Any:
        if name not in moved:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        place, _, renamed = moved[name].partition(":")
        new, own = importlib.import_module(place), renamed or name
        is_module = not hasattr(new, own)
        _warn(f"{module}.{name}", place if is_module else f"{place}.{own}")
        return new if is_module else getattr(new, own)

    return find


def _warn(old: str, new: str) -> None:
    # Level 3 is who imports; Python leaves the frames of its own import system out.
    warnings.warn(f"{old} is now {new}; the old name goes with the next release", DeprecationWarning, stacklevel=3)
