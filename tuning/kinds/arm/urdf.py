"""From a URDF to the chain between two of its links; nothing here imports jax.

The format: https://wiki.ros.org/urdf/XML/joint. What has a default there gets it; what is required must be there.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from tuning.files.errors import InputError, Mistake, input_error
from tuning.kinds.arm.chain import FARTHEST, Chain, about
from tuning.kinds.arm.names import listed, shown
from tuning.kinds.arm.urdf_xml import JointText, RobotText, read_urdf

_TURNING = ("revolute", "continuous")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_LENGTHS = (1e-6, 1e6)
"""Of an axis; a unit vector is meant."""
_FARTHEST_STEP = 1e6
"""Number of an origin [m, rad]."""
_MOST_TOLD = 10
_HALF_TURNS = (-math.pi, math.pi)
"""Range of a joint that turns for ever."""
_LEAVE_OUT = "choose base and tip so that the chain leaves it out"


def read_chain(path: Path, base: str | None, tip: str | None, place: str) -> Chain:
    """Return the turning joints between two links of a URDF, named as there.

    Args:
        path: of the file.
        base: the link that the chain begins with; by default the root.
        tip: the link that it ends with, the hand.
        place: who asks for it, for errors: the study's table of the arm.

    Raises:
        InputError: the file cannot be read, its joints and links are no tree, it has no such chain, or a joint of
            the chain is told wrongly. Lists every mistake, with lines and names of joints.
    """
    robot = read_urdf(path, f"{place}.urdf")
    parents = _tree(robot)
    joints = _between(robot, parents, base, tip, place)
    mistakes = _Mistakes(robot)
    moving = [joint for joint in joints if joint.type != "fixed"]
    offset, turned = np.zeros(3), np.eye(3)
    offsets, rotations, axes, ranges = [], [], [], []
    for joint in joints:
        place_of, turn_of = _origin(joint, mistakes)
        offset, turned = offset + turned @ place_of, turned @ turn_of
        if joint.type == "fixed":
            continue
        offsets.append(offset)
        rotations.append(turned)
        axes.append(_axis(joint, mistakes))
        ranges.append(_range(joint, mistakes))
        offset, turned = np.zeros(3), np.eye(3)
    mistakes.raise_any()
    return Chain(
        names=tuple(joint.name for joint in moving),
        offsets=np.stack(offsets),
        rotations=np.stack(rotations),
        axes=np.stack(axes),
        tool_offset=offset,
        tool_rotation=turned,
        ranges=np.array([own or _HALF_TURNS for own in ranges]),
        endless=tuple(own is None for own in ranges),
    )


class _Mistakes:
    """Mistakes of one file, told together."""

    def __init__(self, robot: RobotText):
        self._path = robot.path
        self._found: dict[Mistake, int] = {}

    def add(self, line: int, what: str, problem: str, fix: str) -> None:
        where = f"{self._path}: line {line}{f': {what}' if what else ''}"
        self._found.setdefault(Mistake(where, problem, fix), line)

    def of(self, joint: JointText, tag: str, problem: str, fix: str) -> None:
        """Add one about an element of a joint, at its line."""
        line = joint.elements[tag].line if tag in joint.elements else joint.line
        self.add(line, f"joint {shown(joint.name)}", problem, fix)

    @property
    def count(self) -> int:
        """How many there are so far."""
        return len(self._found)

    def raise_any(self) -> None:
        if self._found:
            raise InputError(*sorted(self._found, key=self._found.__getitem__)[:_MOST_TOLD])


def _tree(robot: RobotText) -> Mapping[str, JointText]:
    """Return the joint above each link, after checking that joints and links are one tree."""
    mistakes = _Mistakes(robot)
    links: dict[str, int] = {}
    for name, line in robot.links:
        if not name:
            mistakes.add(line, "", "a link has no name", 'write <link name="...">')
        elif name in links:
            mistakes.add(
                line, f"link {shown(name)}", f"is also in line {links[name]}", "give each a name of its own"
            )
        links.setdefault(name, line)
    if not links:
        raise input_error(robot.path, "has no links", "a URDF of an arm has links, and joints between them")
    names: dict[str, int] = {}
    parents: dict[str, JointText] = {}
    for joint in robot.joints:
        what = f"joint {shown(joint.name)}"
        if not joint.name:
            mistakes.add(joint.line, "", "a joint has no name", 'write <joint name="..." type="...">')
        elif joint.name in names:
            mistakes.add(joint.line, what, f"is also in line {names[joint.name]}", "give each a name of its own")
        names.setdefault(joint.name, joint.line)
        ends = [_end(joint, tag, links, mistakes) for tag in ("parent", "child")]
        child = ends[1]
        if child is None:
            continue
        if child in parents:
            other = parents[child]
            problem = f"link {shown(child)} is also the child of joint {shown(other.name)}, line {other.line}"
            mistakes.of(joint, "child", problem, "a link hangs on one joint only: name another child")
        parents.setdefault(child, joint)
    mistakes.raise_any()
    _check_circles(parents, mistakes)
    roots = [name for name in links if name not in parents]
    if len(roots) > 1:
        problem = f"has {len(roots)} links that hang on no joint: {listed(roots)}; one tree has one root"
        raise input_error(robot.path, problem, "add the joints that are missing, or remove what is apart")
    return parents


def _end(joint: JointText, tag: str, links: Mapping[str, int], mistakes: _Mistakes) -> str | None:
    """Return the link that a joint names as its parent or child."""
    element = joint.elements.get(tag)
    name = None if element is None else element.attributes.get("link")
    if name is None:
        mistakes.of(joint, tag, f'has no <{tag} link="...">', "add it: a joint is between two links")
    elif name not in links:
        mistakes.of(joint, tag, f"{tag} {shown(name)} is no link of the file", _suggested(name, list(links)))
        return None
    return name


def _check_circles(parents: Mapping[str, JointText], mistakes: _Mistakes) -> None:
    # Links from which the root is reached, or a circle already told.
    done: set[str] = set()
    for start in parents:
        way: dict[str, None] = {}
        link = start
        while link in parents and link not in done and link not in way:
            way[link] = None
            link = parents[link].elements["parent"].attributes["link"]
        if link in way:
            links = list(way)[list(way).index(link) :]
            joint = parents[links[0]]
            circle = listed([parents[one].name for one in reversed(links)])
            problem = f"is in a circle of joints: {circle}"
            mistakes.of(joint, "parent", problem, "a URDF is a tree: name another parent or child")
        done.update(way)
    mistakes.raise_any()


def _between(
    robot: RobotText, parents: Mapping[str, JointText], base: str | None, tip: str | None, place: str
) -> list[JointText]:
    """Return the joints from the base to the tip."""
    order = [name for name, _ in robot.links]
    if tip not in order:
        tips = _tips(order, parents)
        got = "is missing" if tip is None else f"got {tip!r}"
        hint = (
            _suggested(tip or "", tips, f"tips of {robot.path}") if tips else f"{robot.path} has no moving joint"
        )
        raise input_error(f"{place}.tip", f"{got}; needs the name of the hand's link", hint)
    chain: list[JointText] = []
    link, above = tip, [tip]
    while link in parents and link != base:
        chain.append(parents[link])
        link = chain[-1].elements["parent"].attributes["link"]
        above.append(link)
    if base is not None and link != base:
        what = "which is not above" if base in order else "which is no link, so not above"
        problem = f"got {base!r}, {what} {tip!r} in {robot.path}"
        raise input_error(f"{place}.base", problem, _suggested(base, above[1:], f"links above {shown(tip)}"))
    chain.reverse()
    _check_types(robot, chain)
    if not any(joint.type in _TURNING for joint in chain):
        problem = f"has no moving joint between {shown(link)!r} and {shown(tip)!r}"
        tips = _tips(order, parents)
        fix = f"tips there are: {listed(tips)}" if tips else "a URDF of an arm has revolute joints"
        raise input_error(robot.path, problem, fix)
    return chain


def _check_types(robot: RobotText, chain: Sequence[JointText]) -> None:
    mistakes = _Mistakes(robot)
    for joint in chain:
        what = f"joint {shown(joint.name)}"
        if joint.type not in (*_TURNING, "fixed"):
            got = f"is {shown(joint.type)}" if joint.type else "has no type"
            mistakes.add(joint.line, what, f"{got}; allowed: revolute, continuous, fixed", _LEAVE_OUT)
        if "mimic" in joint.elements:
            other = joint.elements["mimic"].attributes.get("joint", "")
            problem = (
                f"mimics joint {shown(other)}: it has no motion of its own, and no stiffness that could be set"
            )
            mistakes.of(joint, "mimic", problem, f"{_LEAVE_OUT}; or remove <mimic> if it has a drive of its own")
        for tag in ("origin", "axis", "limit"):
            near = difflib.get_close_matches(tag, [other.lower() for other in joint.others], 1, 0.75)
            if tag not in joint.elements and near:
                mistakes.add(joint.line, what, f"has no <{tag}>, but <{shown(near[0])}>", f"did you mean <{tag}>?")
    mistakes.raise_any()


def _tips(links: Sequence[str], parents: Mapping[str, JointText]) -> list[str]:
    """Return the links that a turning joint moves: the ends of the tree first, else as the file has them."""
    inner = {joint.elements["parent"].attributes["link"] for joint in parents.values()}
    moved: dict[str, bool] = {}
    for start in links:
        way, link = [], start
        while link in parents and link not in moved and parents[link].type not in _TURNING:
            way.append(link)
            link = parents[link].elements["parent"].attributes["link"]
        turns = moved.get(link, link in parents)
        moved.update(dict.fromkeys([*way, link], turns))
    return sorted((name for name in links if moved[name]), key=lambda name: name in inner)


def _origin(joint: JointText, mistakes: _Mistakes) -> tuple[np.ndarray, np.ndarray]:
    """Return where a joint's frame is in its parent's [m], and how it is turned, Rz(yaw) Ry(pitch) Rx(roll)."""
    place = _numbers(joint, "origin", "xyz", [0.0, 0.0, 0.0], mistakes, largest=_FARTHEST_STEP)
    roll, pitch, yaw = _numbers(joint, "origin", "rpy", [0.0, 0.0, 0.0], mistakes, largest=_FARTHEST_STEP)
    return np.array(place), about("z", yaw) @ about("y", pitch) @ about("x", roll)


def _axis(joint: JointText, mistakes: _Mistakes) -> np.ndarray:
    if "axis" in joint.elements and "xyz" not in joint.elements["axis"].attributes:
        mistakes.of(joint, "axis", "<axis> has no xyz", 'write <axis xyz="0 0 1"/>, or leave <axis> out for 1 0 0')
    axis = _numbers(joint, "axis", "xyz", [1.0, 0.0, 0.0], mistakes)
    shortest, longest = _LENGTHS
    if not shortest <= math.hypot(*axis) <= longest:
        told = " ".join(f"{v:g}" for v in axis)
        problem = f"<axis> {told} is no direction: its length must be between {shortest:g} and {longest:g}"
        mistakes.of(joint, "axis", problem, "give the direction that it turns about, e.g. 0 0 1")
        return np.array([1.0, 0.0, 0.0])
    return np.array(axis) / np.linalg.norm(np.array(axis))


def _range(joint: JointText, mistakes: _Mistakes) -> list[float] | None:
    """Return where a joint may be [rad]; `None` where it turns for ever."""
    if joint.type == "continuous":
        return None
    endless = 'or make it type="continuous" if it turns for ever'
    if "limit" not in joint.elements:
        problem = "is revolute and has no <limit>: by the format it could not move"
        mistakes.of(joint, "limit", problem, f'add <limit lower="..." upper="..."/> [rad], {endless}')
        return None
    given = joint.elements["limit"].attributes
    for key in {"lower", "upper"} - given.keys():
        near = difflib.get_close_matches(
            key, [other.lower() for other in given if other not in ("lower", "upper")], 1
        )
        if near:
            mistakes.of(joint, "limit", f"<limit> has no {key}, but {shown(near[0])}", f"did you mean {key}?")
    before = mistakes.count
    low, high = (
        _numbers(joint, "limit", key, [0.0], mistakes, otherwise=endless)[0] for key in ("lower", "upper")
    )
    if mistakes.count > before:
        return None
    told = f"lower {low:g} and upper {high:g}" if {"lower", "upper"} <= given.keys() else ""
    if low > high:
        problem = f"<limit> has {told or f'lower {low:g} above upper {high:g}; left out, one is 0'}"
        mistakes.of(joint, "limit", problem, f"give lower below upper [rad], {endless}")
    elif low == high:
        problem = f"<limit> leaves no range: lower {low:g} and upper {high:g}; left out, they are 0"
        mistakes.of(joint, "limit", problem, f"give lower below upper [rad], {endless}")
    elif low < -FARTHEST and high > FARTHEST:
        return None  # how some files write that there is no limit
    elif max(abs(low), abs(high)) > FARTHEST:
        problem = f"<limit> goes from {low:g} to {high:g} rad; allowed: within ±{FARTHEST:g}"
        mistakes.of(joint, "limit", problem, f"give what it really has, {endless}")
    return [low, high]


def _numbers(
    joint: JointText,
    tag: str,
    key: str,
    default: list[float],
    mistakes: _Mistakes,
    *,
    otherwise: str = "",
    largest: float = math.inf,
) -> list[float]:
    """Return the numbers of an attribute, as many as its default has."""
    element = joint.elements.get(tag)
    text = None if element is None else element.attributes.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) == len(default) and all(_NUMBER.fullmatch(word) for word in words):
        values = [float(word) for word in words]
        if all(math.isfinite(value) and abs(value) <= largest for value in values):
            return values
    count = "one finite number" if len(default) == 1 else f"{len(default)} finite numbers"
    count += f" within ±{largest:g}" if math.isfinite(largest) else ""
    example = " ".join(f"{v:g}" for v in default)
    fix = f'write it like {key}="{example}"{f", {otherwise}" if otherwise else ""}'
    mistakes.of(joint, tag, f'<{tag}> has {key}="{_short(text)}"; needs {count}', fix)
    return default


def _short(text: str) -> str:
    cut = text if len(text) <= 60 else f"{text[:60]} …"
    return cut if cut.isprintable() else repr(cut)[1:-1]


def _suggested(name: str, among: Sequence[str], what: str = "links") -> str:
    near = difflib.get_close_matches(name.lower(), [one.lower() for one in among], 1)
    hint = next((f"did you mean {shown(one)}? " for one in among if near and one.lower() == near[0]), "")
    return f"{hint}{what}: {listed(among)}"
