"""Reads a URDF strictly as XML: what its links and joints say, as text, each with its line.

A URDF comes from anywhere, so that nothing is repaired and nothing is left out: what is no well-formed XML to its
last byte is refused, and so are documents that define entities.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from tuning.files.errors import InputError, input_error
from tuning.kinds.arm.names import shown

Attributes = Mapping[str, str]

_LARGEST = 64
"""Size of a file [MB] that is still read; those of robots have at most a few."""
_IN_JOINT: dict[str, set[str] | None] = {
    "origin": {"xyz", "rpy"},
    "parent": None,
    "child": None,
    "axis": {"xyz"},
    "limit": None,
    "mimic": None,
}
"""Elements of a joint that kinematics are made of, and all attributes that they may have; `None`: any."""
_OLD_XACRO = {"property", "macro", "include", "if", "unless", "insert_block"}
"""What xacro's elements are called in files that have no prefix for them."""
_EXPAND = "expand it first: xacro FILE.xacro -o FILE.urdf, then name FILE.urdf"
_DESCRIBE = "convert it to URDF with its own tools, or describe the arm in the study: [[arm.joints]] or [[arm.dh]]"
_OTHER_ROOTS = {"sdf": "SDF (of Gazebo)", "mujoco": "MJCF (of MuJoCo)", "COLLADA": "COLLADA, a mesh"}


@dataclass(frozen=True)
class Element:
    """One element of a joint.

    Args:
        line: where it begins.
        attributes: as they stand there.
    """

    line: int
    attributes: Attributes


@dataclass
class JointText:
    """What the file says of a joint.

    Args:
        line: where it begins.
        name: empty where it has none.
        type: empty where it has none.
        elements: those that kinematics are made of, by tag.
        others: tags of all others.
    """

    line: int
    name: str
    type: str
    elements: dict[str, Element] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)


@dataclass
class RobotText:
    """What a URDF says, in its order.

    Args:
        path: of the file.
        links: name and line of each.
        joints: all of them.
    """

    path: Path
    links: list[tuple[str, int]] = field(default_factory=list)
    joints: list[JointText] = field(default_factory=list)


def read_urdf(path: Path, place: str) -> RobotText:
    """Return what a URDF says.

    Args:
        path: of the file.
        place: who names it, for errors.

    Raises:
        InputError: the file cannot be read, is no well-formed XML, no URDF, xacro that is not expanded, or says
            something of a joint twice.
    """
    reader = _Reader(path)
    reader.read(_content(path, place))
    return reader.robot


def _content(path: Path, place: str) -> bytes:
    if path.is_dir():
        raise input_error(place, f"{path} is a folder", "name the .urdf file in it")
    if not path.is_file():
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*")], 1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise input_error(place, f"{path}: no such file", f"{hint}paths start at the study's folder")
    try:
        if path.stat().st_size > _LARGEST * 10**6:
            problem = f"{path} has {path.stat().st_size / 1e6:.0f} MB; at most {_LARGEST} MB are read"
            raise input_error(place, problem, "leave meshes in files of their own")
        return path.read_bytes()
    except OSError as error:
        raise input_error(place, f"{path} cannot be read ({error.strerror})", "check its permissions") from None


class _Reader:
    """Follows a parser through a document, and keeps what belongs to links and joints of the robot itself."""

    def __init__(self, path: Path):
        self.robot = RobotText(path)
        self._open: list[tuple[str, int]] = []
        self._joint: JointText | None = None
        self._xacro = {"xacro"}
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._doctype

    def read(self, content: bytes) -> None:
        if not content.strip():
            raise input_error(self.robot.path, "is empty", "name a file that holds a URDF")
        try:
            self._parser.Parse(content, True)
        except InputError:
            raise
        except expat.ExpatError as error:
            raise self._broken(error) from None
        except (LookupError, ValueError) as error:  # an encoding that Python does not know either
            raise input_error(self.robot.path, f"cannot be read as XML ({error})", "save it as UTF-8") from None

    def _broken(self, error: expat.ExpatError) -> InputError:
        reason = expat.errors.messages[error.code]
        where = f"{self.robot.path}: line {error.lineno}, column {error.offset + 1}"
        cut = {expat.errors.XML_ERROR_NO_ELEMENTS, expat.errors.XML_ERROR_UNCLOSED_TOKEN}
        cut |= {expat.errors.XML_ERROR_PARTIAL_CHAR, expat.errors.XML_ERROR_UNCLOSED_CDATA_SECTION}
        if reason in cut and self._open:
            tag, line = self._open[-1]
            problem = f"ends within <{tag}>, which begins in line {line}"
            return input_error(where, problem, "the file was cut off: fetch it again")
        if not self._open and not self.robot.links:
            problem = f"is no URDF that can be read: no well-formed XML ({reason})"
            return input_error(where, problem, "name a URDF; its first element is <robot>")
        within = f" within <{self._open[-1][0]}>" if self._open else ""
        return input_error(where, f"no well-formed XML{within} ({reason})", "mend that line")

    def _doctype(self, *_: object) -> None:
        where = f"{self.robot.path}: line {self._parser.CurrentLineNumber}"
        raise input_error(where, "has a DOCTYPE, which could define entities; a URDF needs none", "remove it")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line, depth = self._parser.CurrentLineNumber, len(self._open)
        if depth == 0:
            self._check_root(tag, attributes, line)
        self._xacro |= {
            key.partition(":")[2] for key, uri in attributes.items() if key.startswith("xmlns:") and "xacro" in uri
        }
        self._check_expanded(tag, attributes, line)
        if depth == 1 and tag == "link":
            self.robot.links.append((attributes.get("name", ""), line))
        elif depth == 1 and tag == "joint":
            self._joint = JointText(line, attributes.get("name", ""), attributes.get("type", ""))
            self.robot.joints.append(self._joint)
        elif depth == 2 and self._joint is not None:
            self._keep(self._joint, tag, attributes, line)
        self._open.append((tag, line))

    def _end(self, _: str) -> None:
        self._open.pop()
        if len(self._open) == 1:
            self._joint = None

    def _keep(self, joint: JointText, tag: str, attributes: dict[str, str], line: int) -> None:
        if tag not in _IN_JOINT:
            joint.others.append(tag)
            return
        if tag in joint.elements:
            problem = f"has a second <{tag}>; the first is in line {joint.elements[tag].line}"
            raise self._error(joint, line, problem, "leave one of them")
        allowed = _IN_JOINT[tag]
        unknown = [] if allowed is None else [key for key in attributes if key not in allowed]
        if allowed and unknown:
            problem = f"<{tag}> has the attribute {shown(unknown[0])}; allowed: {', '.join(sorted(allowed))}"
            raise self._error(joint, line, problem, "write it so")
        joint.elements[tag] = Element(line, attributes)

    def _error(self, joint: JointText, line: int, problem: str, fix: str) -> InputError:
        return input_error(f"{self.robot.path}: line {line}: joint {shown(joint.name)}", problem, fix)

    def _check_root(self, tag: str, attributes: dict[str, str], line: int) -> None:
        if tag == "robot":
            return
        where = f"{self.robot.path}: line {line}"
        if tag in _OTHER_ROOTS:
            raise input_error(where, f"is {_OTHER_ROOTS[tag]}, not URDF", _DESCRIBE)
        if ":" in tag and any("xacro" in value for value in (tag, *attributes.values())):
            raise input_error(where, f"is xacro (<{shown(tag)}>), not URDF", _EXPAND)
        problem = f"is no URDF that can be read: its first element is <{shown(tag)}>, not <robot>"
        raise input_error(where, problem, "name a URDF")

    def _check_expanded(self, tag: str, attributes: dict[str, str], line: int) -> None:
        """Refuse what xacro has yet to replace. A declared prefix alone is left over in many expanded files."""
        prefix, colon, _ = tag.partition(":")
        inside = [outer for outer, _ in self._open[1:2]] or [tag]
        of_xacro = (colon and prefix in self._xacro) or (len(self._open) == 1 and tag in _OLD_XACRO)
        found = f"<{tag}>" if of_xacro else None
        if found is None and inside[0] in ("link", "joint", "robot"):
            found = next(
                (f'{key}="{text}"' for key, text in attributes.items() if re.search(r"\$[{(]", text)), None
            )
        if found is not None:
            where = f"{self.robot.path}: line {line}"
            raise input_error(where, f"is xacro that is not expanded: {shown(found)}", _EXPAND)
