"""ROS 2: parameters of a node and of a ros2_control controller, and their declaration with types and bounds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

import yaml

from tuning.exports.artefact import Artefact, Subject
from tuning.exports.c99.printing import decimal
from tuning.exports.layout import told
from tuning.exports.ranges import Range
from tuning.files.text import plain
from tuning.study.parts.base import Part

_USAGE = """```sh
ros2 run YOUR_PACKAGE YOUR_NODE --ros-args --params-file {name}_params.yaml
```

```cmake
generate_parameter_library({name}_parameters {name}_parameters.yaml)
```

`{name}_controller.yaml` configures a ros2_control controller: replace `YOUR_PACKAGE/YourController` by your
class{joints}. `{name}_parameters.yaml` declares every parameter for generate_parameter_library: type,
default, bounds, description; what shapes the program is read-only. What a study calls `type` is `variant` here:
ros2_control takes a parameter called `type` for the plugin's. Numbers always have a decimal point, so that
every YAML reader takes them for numbers. The node itself is yours: the step is what `--to c99` writes."""


_VARIANT = "variant"
"""What `type` is called: ros2_control's spawner and manager read a controller's `type` as that of its plugin."""
_WHICH = "which one of several this is: type in a study"


@dataclass(frozen=True)
class Entry:
    """One parameter of the configuration.

    Args:
        path: in the tables.
        value: of the configuration.
        declaration: for generate_parameter_library.
    """

    path: tuple[str, ...]
    value: Any
    declaration: dict[str, Any]


def write_ros2(subject: Subject) -> Artefact:
    """Return the YAML files."""
    name = subject.program.name
    parts = subject.deployable.parts
    entries = [entry for root, part in parts.items() for entry in _entries(subject, part, root)]
    entries += [] if parts else _numbers(subject)
    step = subject.deployable.sample_time
    parameters = _tree({entry.path: entry.value for entry in entries})
    if step is not None:
        parameters = {"sample_time": step, **parameters}
    declarations = _tree({entry.path: entry.declaration for entry in entries})
    if step is not None:
        about = f"Time between two samples [s]; what the {subject.deployable.noun} was made for."
        declared = {"type": "double", "default_value": step, "description": about, "read_only": True}
        declarations = {"sample_time": {**declared, "validation": {"gt<>": [0.0]}}, **declarations}
    place, joints, declared = _joints(subject)
    declarations = {place: declared, **declarations}
    controller: dict[str, Any] = {place: joints, **parameters}
    manager: dict[str, Any] = {name: {"type": "YOUR_PACKAGE/YourController"}}
    if step is not None:
        manager = {"update_rate": round(1.0 / step), **manager}
    files: dict[str, str | bytes] = {
        f"{name}_params.yaml": _yaml(subject, {name: {"ros__parameters": parameters}}),
        f"{name}_controller.yaml": _yaml(
            subject, {"controller_manager": {"ros__parameters": manager}, name: {"ros__parameters": controller}}
        ),
        f"{name}_parameters.yaml": _yaml(subject, {f"{name}_parameters": declarations}),
    }
    named = "" if joints == list(subject.deployable.joints) else ", and the joint" + "s" * (place == "joints")
    figures = {"ros2": {"parameters": parameters, "joints": {place: joints}}}
    return Artefact(files, "ros2", _USAGE.format(name=name, joints=named), figures)


def _joints(subject: Subject) -> tuple[str, str | list[str], dict[str, Any]]:
    """Return the parameter that names the joints, its value for the controller, and its declaration."""
    known, count = list(subject.deployable.joints), subject.deployable.joint_count
    if count == 1 and not known:
        declared = {"type": "string", "default_value": "", "description": "Name of the joint.", "read_only": True}
        return "joint", "YOUR_JOINT", declared
    names = known or [f"YOUR_JOINT_{i + 1}" for i in range(count)]
    # A default is written into source code between quotes.
    default = known if all(map(_is_plain, known)) else []
    about = "Names of the joints, from the base to the hand, in the order of every list."
    return (
        *("joints", names),
        {"type": "string_array", "default_value": default, "description": about, "read_only": True},
    )


def _is_plain(text: str) -> bool:
    return text == _quotable(text)


def _quotable(text: str) -> str:
    """Return a text as generated C++ and Python may hold it between double quotes."""
    return " ".join(text.replace('"', "'").replace("\\", "/").split())


def _numbers(subject: Subject) -> Iterator[Entry]:
    """Yield every tunable number of a module without tables; an array is a list of its numbers, row by row."""
    program = subject.program
    for (path, leaf), value in zip(program.parameters.places, program.defaults, strict=True):
        here = tuple(str(key) for key in path)
        number = [float(one) for one in value.flat] if value.ndim else float(value)
        about = f"{leaf.meaning} [{leaf.unit}]" if leaf.unit else leaf.meaning
        declared = {"type": _type(number), "default_value": number, "description": _quotable(about or here[-1])}
        limits = subject.deployable.range(path)
        validation = {} if value.ndim else _bounds(limits, float)
        yield Entry(here, number, declared | ({"validation": validation} if validation else {}))


def _entries(subject: Subject, part: Part, path: tuple[str, ...]) -> Iterator[Entry]:
    """Yield every value of a part, with its declaration."""
    explained = told(part.target.load())
    for name, field in type(part).model_fields.items():
        value = getattr(part, name)
        here = (*path, name)
        if isinstance(value, Part):
            yield from _entries(subject, value, here)
        elif value is not None:
            meaning, unit = explained.get(name, (_WHICH if name == "type" else "", ""))
            about = f"{meaning} [{unit}]" if unit else meaning
            declaration = _declaration(subject, part, here, value, field.annotation, about)
            yield Entry((*path, _VARIANT) if name == "type" else here, value, declaration)


def _declaration(
    subject: Subject, part: Part, path: tuple[str, ...], value: Any, annotation: Any, about: str
) -> dict[str, Any]:
    is_tunable = isinstance(value, float) and path[-1] not in part.static
    declared: dict[str, Any] = {
        **{"type": _type(value), "default_value": value},
        "description": _quotable(about or path[-1]),
    }
    if not is_tunable:
        declared["read_only"] = True
    validation: dict[str, Any] = {}
    choices = [one for option in (annotation, *get_args(annotation)) for one in _literals(option)]
    if choices and isinstance(value, str):
        validation["one_of<>"] = [choices]
    elif isinstance(value, int | float) and not isinstance(value, bool):
        validation |= _bounds(subject.deployable.range(path), type(value))
    return declared | ({"validation": validation} if validation else {})


def _bounds(limits: Range, number: type) -> dict[str, Any]:
    validation = {}
    if limits.low is not None:
        validation["gt<>" if limits.is_low_open else "gt_eq<>"] = [number(limits.low)]
    if limits.high is not None:
        validation["lt<>" if limits.is_high_open else "lt_eq<>"] = [number(limits.high)]
    return validation


def _literals(annotation: Any) -> list[Any]:
    return list(get_args(annotation)) if get_origin(annotation) is Literal else []


def _type(value: Any) -> str:
    if isinstance(value, list):
        return "double_array"
    return {bool: "bool", int: "int", float: "double", str: "string"}[type(value)]


def _tree(values: dict[tuple[str, ...], Any]) -> dict[str, Any]:
    root: dict[str, Any] = {}
    for path, value in values.items():
        table = root
        for key in path[:-1]:
            table = table.setdefault(key, {})
        table[path[-1]] = value
    return root


class _Dumper(yaml.SafeDumper):
    """Writes numbers that every reader takes for floating-point ones."""


def _represent(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:float", decimal(value))


_Dumper.add_representer(float, _represent)


def _yaml(subject: Subject, tables: dict[str, Any]) -> str:
    text = yaml.dump(tables, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    head = (plain(line) for line in (subject.program.title, subject.banner))
    return "".join(f"# {line}\n" for line in head) + text
