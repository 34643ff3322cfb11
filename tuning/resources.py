"""The files that ship with the lab: example studies, joints, signal maps."""

from __future__ import annotations

from pathlib import Path

from tuning.errors import input_error

_INSTALLED = Path(__file__).parent / "configs"
CONFIGS = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parent.parent / "configs"
"""In a wheel the folder lies in the package, in a checkout beside it."""


def preset_path(name: object, place: str) -> Path:
    """Return the file of a joint preset; `place` names who asks for it in the error."""
    return choose("joints", name, place)


def example_path(kind: object, place: str) -> Path:
    """Return the file of an example study."""
    return choose("studies", kind, place)


def choose(folder: str, name: object, place: str) -> Path:
    """Return a shipped file by its folder and name; `place` names who asks for it in the error."""
    known = {path.stem: path for path in sorted((CONFIGS / folder).glob("*.toml"))}
    if not isinstance(name, str) or name not in known:
        raise input_error(place, f"got {name!r}", f"allowed: {', '.join(known)}")
    return known[name]
