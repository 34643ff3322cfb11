"""The files that ship with the lab: example studies, joints, arms, signal maps, tuned configurations.

Wherever a path to a TOML file is asked for, `shipped:NAME` is one of these: `shipped:serial`, `shipped:logs/hebi`.
"""

from __future__ import annotations

import difflib
import re
from pathlib import Path

from tuning.files.errors import input_error

SHIPPED = "shipped:"
_ROOT = Path(__file__).parents[2]
_INSTALLED = Path(__file__).parents[1] / "configs"
CONFIGS = _INSTALLED if _INSTALLED.is_dir() else _ROOT / "configs"
"""In a wheel the folder lies in the package, in a checkout beside it."""


def shipped_files() -> dict[str, Path]:
    """Return every shipped file by its name, `FOLDER/STEM`: studies first, then by folder."""
    found = sorted(CONFIGS.glob("*/*.toml"), key=lambda p: (p.parent.name != "studies", p.parent.name, p.stem))
    return {f"{path.parent.name}/{path.stem}": path for path in found}


def summary_of(path: Path) -> str:
    """Return the first sentence of the comment that a shipped file begins with: what it is."""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.removeprefix("#").strip())
    return re.split(r"(?<!\bal)\.(?:\s|$)|: vsajax", " ".join(lines), maxsplit=1)[0]


def located(path: Path) -> Path:
    """Return where a user's file lies: `shipped:NAME` is looked up, any other path stays as it is.

    Raises:
        InputError: no shipped file has that name, or several have.
    """
    text = path.as_posix()
    return find_shipped(text.removeprefix(SHIPPED), text) if text.startswith(SHIPPED) else path


def find_shipped(name: str, place: str) -> Path:
    """Return a shipped file by `FOLDER/STEM`, or by its stem alone: a study's, or one that no other file has.

    Raises:
        InputError: no file has that name, or several have; `place` says where it was read.
    """
    files = shipped_files()
    wanted = name.removeprefix(SHIPPED).removeprefix("configs/").removesuffix(".toml")
    for full in (wanted, f"studies/{wanted}"):
        if full in files:
            return files[full]
    same = [full for full in files if full.split("/")[1] == wanted]
    if len(same) == 1:
        return files[same[0]]
    if same:
        raise input_error(place, "names several shipped files", f"one of {', '.join(SHIPPED + f for f in same)}")
    near = difflib.get_close_matches(wanted, [*files, *(full.split("/")[1] for full in files)], 1)
    studies = ", ".join(path.stem for path in files.values() if path.parent.name == "studies")
    hint = f"did you mean {SHIPPED}{near[0]}?" if near else f"allowed: {studies}, …"
    raise input_error(place, "no such file ships with vsajax", f"{hint} `vsajax init --list` prints them all")


def example_path(kind: object, place: str) -> Path:
    """Return the file of an example study."""
    return choose("studies", kind, place)


def choose(folder: str, name: object, place: str) -> Path:
    """Return a shipped file by its folder and name; `place` names who asks for it in the error."""
    known = {path.stem: path for path in sorted((CONFIGS / folder).glob("*.toml"))}
    stem = name.removeprefix(SHIPPED).removeprefix(f"{folder}/") if isinstance(name, str) else None
    if stem not in known:
        raise input_error(place, f"got {name!r}", f"allowed: {', '.join(known)}")
    return known[stem]
