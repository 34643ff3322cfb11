"""What comes from outside vsajax: who may be imported, where it is, and which version of it that is.

There are two ways in. Installing a package with an entry point in a group `vsajax.…` is consent: its metadata is
read when a tag is unknown, and its module is imported when something uses the tag. A module that a file names
itself, `package.module:name`, is imported only if the user consented to it outside the file: by `--plugin`, in the
environment, or in a file of their own. Nothing is ever imported from the folder in which a command runs.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata, util
from pathlib import Path
from typing import Any

from tuning.files.errors import Mistake, input_error
from tuning.files.toml import read_toml
from tuning.study.refs import Ref

ENVIRONMENT = "VSAJAX_PLUGINS"
"""Names the modules that may be imported, with commas between them."""
SOURCE = "source"
"""How the version of what is not installed begins: a hash of its source follows."""
_GROUP = "vsajax."

_given: list[str] = []
"""Modules that this process may import: those of `--plugin`, or those that a worker was sent."""


@dataclass(frozen=True)
class Origin:
    """Where something foreign comes from.

    Args:
        ref: what is loaded.
        distribution: the installed package that it belongs to; empty where there is none.
        version: of that package; of a module without one, a hash of its source.
    """

    ref: Ref
    distribution: str
    version: str

    @property
    def name(self) -> str:
        """The package's: the installed one's, or that of the module."""
        return self.distribution or self.ref.module.partition(".")[0]

    @property
    def said(self) -> str:
        """For people."""
        return f"{self.name} {self.version}"


class Refused(Exception):
    """Something foreign that is not used, and why.

    Args:
        problem: what is wrong.
        fix: the way out.
    """

    def __init__(self, problem: str, fix: str):
        self.problem, self.fix = problem, fix
        super().__init__(problem)


class Unknown(Refused):
    """Nothing has a tag."""


@contextmanager
def consenting(*modules: str) -> Iterator[None]:
    """Let modules be imported, with all that lies in them, within the block."""
    _given.extend(modules)
    try:
        yield
    finally:
        for module in modules:
            _given.remove(module)


def consented() -> list[str]:
    """Return the modules that the user consented to, in order.

    Raises:
        InputError: the user's own file cannot be read, or names no modules.
    """
    named = [name.strip() for name in os.environ.get(ENVIRONMENT, "").split(",")]
    return sorted({*_given, *filter(None, named), *_in_file(own_file())})


def own_file() -> Path:
    """Return the user's own file of plug-ins, whether it is there or not."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "vsajax" / "plugins.toml"


def require_consent(ref: Ref) -> None:
    """Refuse what a file names by its module, unless the user consented to that outside the file.

    Raises:
        Refused: they did not, or it is no reference.
        InputError: as `consented`.
    """
    if not ref.is_whole:
        raise Refused(f"got {str(ref)!r}, which is not of the form package.module:Name", "write it so")
    if not any(f"{ref.module}.".startswith(f"{allowed}.") for allowed in consented()):
        top = ref.module.partition(".")[0]
        fix = (
            f"if you trust it, say so outside the file: --plugin {top}, or {ENVIRONMENT}={top}, or "
            f'modules = ["{top}"] in {own_file()}'
        )
        raise Refused(f"got {str(ref)!r}; nobody consented to importing {ref.module}", fix)


def load_named(ref: Ref) -> tuple[Any, Origin]:
    """Return what a reference leads to, to which the user has consented.

    Raises:
        Refused: it cannot be imported.
    """
    return _import(ref, ""), _origin_of(ref)


def installed(registry: str) -> Mapping[str, list[metadata.EntryPoint]]:
    """Return the entry points of a registry by their tags; nothing is imported."""
    return _installed(registry, tuple(sys.path))


@cache
def _installed(registry: str, path: tuple[str, ...]) -> Mapping[str, list[metadata.EntryPoint]]:
    """Return what `installed` does, of what lies on a path."""
    del path
    found: dict[str, list[metadata.EntryPoint]] = {}
    with _away_from_here():
        for point in metadata.entry_points(group=f"{_GROUP}{registry}"):
            found.setdefault(point.name, []).append(point)
    return found


def load_installed(points: list[metadata.EntryPoint]) -> tuple[Any, Origin]:
    """Return what the entry points of one tag stand for: there must be one.

    Raises:
        Refused: several packages claim the tag, or it cannot be imported.
    """
    if len(points) > 1:
        names = " and ".join(sorted(origin_of_point(point).said for point in points))
        raise Refused(f"got {points[0].name!r}, which both {names} claim", "uninstall one of them")
    origin = origin_of_point(points[0])
    return _import(origin.ref, f" of {origin.said}"), origin


def origin_of_point(point: metadata.EntryPoint) -> Origin:
    """Return where an entry point leads; nothing is imported."""
    distribution = point.dist
    name, version = (distribution.name, distribution.version) if distribution is not None else ("", "unknown")
    return Origin(Ref(point.value.replace(" ", "").partition("[")[0]), name, version)


def is_installed(distribution: str) -> bool:
    """Return whether a package is installed, by its name."""
    with _away_from_here():
        return any(True for _ in metadata.distributions(name=distribution))


def differing(recorded: Mapping[str, Mapping[str, str]], place: str) -> list[Mistake]:
    """Return which of the plug-ins that something was made with are not here, or are here in another version.

    Args:
        recorded: name and version by reference, as studies record them.
        place: who has them, for errors.
    """
    mistakes = []
    for ref, told in recorded.items():
        wanted = f"{told['name']} {told['version']}"
        try:
            found = _origin_of(Ref(ref))
        except Refused as refused:
            mistakes.append(Mistake(place, f"needs {wanted} ({ref}): {refused.problem}", "install it there"))
            continue
        if recorded_of(found) != told:
            problem = f"needs {wanted} ({ref}); here is {found.said}"
            mistakes.append(Mistake(place, problem, f"install {wanted} there"))
    return mistakes


def recorded_of(origin: Origin) -> dict[str, str]:
    """Return what a study records of something foreign, beside its reference."""
    return {"name": origin.name, "version": origin.version}


def _origin_of(ref: Ref) -> Origin:
    """Return where the module of a reference comes from: its package's metadata, or its source.

    Raises:
        Refused: it belongs to no installed package, and cannot be imported, or may not be.
    """
    top = ref.module.partition(".")[0]
    with _away_from_here():
        points = (p for p in metadata.entry_points() if p.group.startswith(_GROUP))
        # An editable installation tells its modules by its entry points alone.
        owners = (p.dist for p in points if p.dist is not None and p.module.partition(".")[0] == top)
        owner = next(owners, None) or _distribution_with(top)
    if owner is not None:
        return Origin(ref, owner.name, owner.version)
    require_consent(ref)
    _imported(ref.module, "")
    return Origin(ref, "", _hash_of(sys.modules[top]))


def _distribution_with(top: str) -> metadata.Distribution | None:
    """Return what is installed with a module at its top, told by the records of what installers wrote.

    `metadata.packages_distributions` asks the disk for every file of every package: a second, for each reference.
    """
    listed = re.compile(rf"^{re.escape(top)}(/|\.[^/,]*,)", re.MULTILINE)
    return next((d for d in metadata.distributions() if listed.search(d.read_text("RECORD") or "")), None)


def _hash_of(package: Any) -> str:
    """Return a version of what is not installed: the hash of its source, all of it if it is a folder."""
    path = Path(package.__file__ or "")
    sources = sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    whole = hashlib.sha256()
    for source in sources:
        whole.update(f"{source.relative_to(path.parent)}\n".encode() + source.read_bytes())
    return f"{SOURCE} {whole.hexdigest()[:12]}"


def _import(ref: Ref, whose: str) -> Any:
    module = _imported(ref.module, whose)
    if not hasattr(module, ref.name):
        raise Refused(f"got {str(ref)!r}; {ref.module}{whose} has no {ref.name}", "name what it defines")
    return getattr(module, ref.name)


def _imported(name: str, whose: str) -> Any:
    try:
        with _away_from_here():
            return import_module(name)
    except Exception as error:
        # Whatever a stranger's module does while it is imported is told, and stops nothing else.
        problem = f"needs {name}{whose}, which cannot be imported ({type(error).__name__}: {error})"
        raise Refused(problem, "install or mend it") from error


@contextmanager
def _away_from_here() -> Iterator[None]:
    """Take the folder in which the command runs off the path, where Python put it there by itself."""
    kept, here = list(sys.path), os.getcwd()
    first = kept[0] if kept else None
    if first is not None and os.path.abspath(first or here) == here:
        sys.path[:] = kept[1:]
    sys.path[:] = [entry for entry in sys.path if entry]
    without = list(sys.path)
    try:
        yield
    finally:
        # What an import has added stays.
        added = [entry for entry in sys.path if entry not in without]
        sys.path[:] = [*kept, *added]


def _in_file(path: Path) -> list[str]:
    if not path.is_file():
        return []
    tables = read_toml(path)
    modules = tables.get("modules")
    if tables.keys() != {"modules"} or not isinstance(modules, list) or not all(map(_is_name, modules)):
        raise input_error(path, "is no list of modules", 'write modules = ["my_springs"], and nothing else')
    return modules


def require_module(name: str, place: str) -> None:
    """Refuse what is no module, without importing it.

    Raises:
        InputError: it is no name, or there is nothing of that name outside the folder in which the command runs.
    """
    if not _is_name(name):
        raise input_error(f"{place} {name}", "is no name of a module", "e.g. --plugin my_springs")
    top = name.partition(".")[0]
    with _away_from_here():
        if top not in sys.modules and util.find_spec(top) is None:
            fix = "install it, or add its folder to PYTHONPATH; the folder you are in is not looked at"
            raise input_error(f"{place} {name}", f"there is no module {top}", fix)


def _is_name(name: object) -> bool:
    return isinstance(name, str) and all(part.isidentifier() for part in name.split("."))
