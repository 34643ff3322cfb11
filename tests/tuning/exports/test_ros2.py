"""Parameters for ROS 2: what generate_parameter_library and ros2_control make of the files."""

from __future__ import annotations

import pytest
import yaml

from tests.tuning.exports.families import FAMILIES, subject
from tuning.exports.deployable import load_deployable
from tuning.exports.formats.ros2 import write_ros2

KEYWORDS = {
    "class",
    "default",
    "double",
    "float",
    "int",
    "lambda",
    "new",
    "operator",
    "switch",
    "template",
    "this",
}


def leaves(tables, path=()):
    for key, value in tables.items():
        if isinstance(value, dict) and "default_value" not in value:
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


@pytest.mark.contract
@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "arm"])
def test_declarations_can_stand_in_generated_code(family):
    files = write_ros2(subject(family)).files
    params, controller, declared = (yaml.safe_load(text) for text in files.values())
    ((_, tables),) = declared.items()
    name = subject(family).program.name
    found = dict(leaves(tables))
    for path, one in found.items():
        # The generator writes both between double quotes, into C++ and into Python.
        for text in (one["description"], *([one["default_value"]] if one["type"] == "string" else [])):
            scope: dict = {}
            exec(f'value = "{text}"', scope)
            assert scope["value"] == text, path
        assert not KEYWORDS & set(path)
        assert all(part.isidentifier() for part in path)
    # The plugin's type is the manager's; a controller's own parameter of that name would be taken for it.
    assert controller["controller_manager"]["ros__parameters"][name]["type"] == "YOUR_PACKAGE/YourController"
    for given in (params[name]["ros__parameters"], controller[name]["ros__parameters"]):
        assert not [path for path, _ in leaves(given) if path[-1] == "type"]
        assert {path for path, _ in leaves(given)} <= found.keys()
    assert controller[name]["ros__parameters"]["joint"] == "YOUR_JOINT"


@pytest.mark.contract
def test_an_arm_of_a_urdf_names_its_joints(request):
    panda = request.config.rootpath / "tests" / "golden" / "panda" / "panda.urdf"
    settings = [f"arm={{urdf='{panda}', tip='panda_hand_tcp'}}", "joints={lower=50.0, upper=500.0}"]
    path, *_ = FAMILIES["arm"]
    deployable = load_deployable(path, settings)
    assert deployable.joints == tuple(f"panda_joint{i + 1}" for i in range(7))
    assert load_deployable(path).joints == ()


@pytest.mark.contract
def test_the_joints_of_an_arm_are_a_list():
    files = write_ros2(subject("arm")).files
    _, controller, declared = (yaml.safe_load(text) for text in files.values())
    name = subject("arm").program.name
    assert controller[name]["ros__parameters"]["joints"] == [f"YOUR_JOINT_{i + 1}" for i in range(4)]
    assert declared[f"{name}_parameters"]["joints"]["type"] == "string_array"
    assert "joint" not in controller[name]["ros__parameters"]
