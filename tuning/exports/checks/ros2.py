"""Loads the YAML files with PyYAML and compares types and values with the manifest."""

import json
import re
from typing import Any

from checking import HERE, Result, run_checks  # pyright: ignore[reportMissingImports]

MANIFEST = json.loads((HERE / "manifest.json").read_text(encoding="utf-8"))
PARAMS, CONTROLLER, DECLARED = (HERE / name for name in MANIFEST["files"])
EXPECTED = MANIFEST["ros2"]["parameters"]
NAME = MANIFEST["name"]
JOINTS = MANIFEST["ros2"]["joints"]
TYPES = {"double": float, "int": int, "bool": bool, "string": str, "double_array": list, "string_array": list}
FLOAT = re.compile(r"-?\d+\.\d+(e[-+]\d\d+)?")


def load(path):
    """Return a file's contents."""
    import yaml

    return yaml.safe_load(path.read_text(encoding="utf-8"))


def flat(tables: dict, path: tuple = ()) -> dict:
    """Return every value by its path."""
    found = {}
    for key, value in tables.items():
        found |= flat(value, (*path, key)) if isinstance(value, dict) else {(*path, key): value}
    return found


def same(found: dict, name: str) -> Result:
    """Compare types and values with the manifest."""
    got, wanted = flat(found), flat(EXPECTED)
    wrong = [
        ".".join(path)
        for path in got.keys() | wanted.keys()
        if type(got.get(path)) is not type(wanted.get(path)) or got.get(path) != wanted.get(path)
    ]
    told = f"{len(wanted)} parameters of the same types and values"
    return Result(name, "failed" if wrong else "passed", f"differ: {', '.join(sorted(wrong))}" if wrong else told)


def parameters() -> Result:
    """Read the node's parameters."""
    return same(load(PARAMS)[NAME]["ros__parameters"], "parameters")


def controller() -> Result:
    """Read the controller's parameters."""
    found = dict(load(CONTROLLER)[NAME]["ros__parameters"])
    joints = {name: found.pop(name, None) for name in JOINTS}
    if joints != JOINTS:
        return Result("controller", "failed", f"names the joints {joints}, not {JOINTS}")
    return same(found, "controller")


def declarations() -> Result:
    """See that every declaration has the type, the default and bounds that hold it."""
    tables = load(DECLARED)[f"{NAME}_parameters"]
    problems = [f"{name} is not declared" for name in JOINTS if name not in tables]
    problems += [
        f"type is taken for the plugin's: {path.name}" for path in (PARAMS, CONTROLLER) if _has_type(path)
    ]
    for path, value in flat(EXPECTED).items():
        declared = tables
        for key in path:
            declared = declared[key]
        place = ".".join(path)
        if type(declared["default_value"]) is not TYPES[declared["type"]] or declared["default_value"] != value:
            problems.append(f"{place}: type or default")
        if re.search(r'["\\\n]', declared["description"]):
            problems.append(f"{place}: its description cannot stand between quotes in generated code")
        for rule, arguments in declared.get("validation", {}).items():
            if not holds(rule, arguments[0], value):
                problems.append(f"{place}: {rule} {arguments[0]} refuses {value}")
    told = "every parameter declared with its type, its default and bounds that hold it"
    return Result("declarations", "failed" if problems else "passed", "; ".join(problems) or told)


def _has_type(path) -> bool:
    return any(path[-1] == "type" for path in flat(load(path)[NAME]["ros__parameters"]))


def holds(rule: str, bound: Any, value: Any) -> bool:
    """Return whether a value passes a validation of generate_parameter_library."""
    return {
        "gt<>": lambda: value > bound,
        "gt_eq<>": lambda: value >= bound,
        "lt<>": lambda: value < bound,
        "lt_eq<>": lambda: value <= bound,
        "one_of<>": lambda: value in bound,
    }[rule]()


def numbers() -> Result:
    """See that every number has a decimal point: some readers take 1e-3 for a string."""
    import yaml

    odd = []
    for path in (PARAMS, CONTROLLER, DECLARED):
        for event in yaml.parse(path.read_text(encoding="utf-8")):
            text = getattr(event, "value", None)
            if isinstance(text, str) and event.style is None and re.fullmatch(r"-?[\d.]+e.*|-?\d*\.\d*", text):
                odd += [] if FLOAT.fullmatch(text) else [f"{path.name}: {text}"]
    return Result("numbers", "failed" if odd else "passed", "; ".join(odd) or "all with a decimal point")


if __name__ == "__main__":
    run_checks([parameters, controller, declarations, numbers])
