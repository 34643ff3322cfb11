"""The formats by name: what writes each of them, imported when asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tuning.files.errors import input_error
from tuning.study.plugins import Refused
from tuning.study.refs import Explained, Ref
from tuning.study.registry import Registry

if TYPE_CHECKING:
    from tuning.exports.artefact import Writer

_HERE = "tuning.exports.formats"
FORMATS: Registry[Any] = Registry(
    "formats",
    {
        "toml": Explained(
            Ref(f"{_HERE}.config:write_toml"), "The configuration itself, every default written out."
        ),
        "json": Explained(Ref(f"{_HERE}.config:write_json"), "The same tables, with their JSON Schema."),
        "c99": Explained(Ref(f"{_HERE}.c99:write_c99"), "A header and a source without allocation or library."),
        "fmi2": Explained(Ref(f"{_HERE}.fmi:write_fmi2"), "A co-simulation unit of FMI 2, with its source."),
        "fmi3": Explained(Ref(f"{_HERE}.fmi:write_fmi3"), "A co-simulation unit of FMI 3, with its source."),
        "ros2": Explained(
            Ref(f"{_HERE}.ros2:write_ros2"), "Parameters of a ROS 2 node, declared with their ranges."
        ),
        "mat": Explained(Ref(f"{_HERE}.mat:write_mat"), "Numbers and golden recording for MATLAB."),
        "stablehlo": Explained(
            Ref(f"{_HERE}.stablehlo:write_stablehlo"), "The compiled step, for Python without vsajax."
        ),
    },
)
"""Where each format's function is defined; of a foreign one, the function: it takes a `Subject`."""


def writer_of(target: str) -> Writer:
    """Return the function that writes a format.

    Raises:
        InputError: there is no such format, or it cannot be imported.
    """
    try:
        found = FORMATS.find(target)
    except Refused as refused:
        raise input_error(f"--to {target}", refused.problem, refused.fix) from None
    return found.ref.load() if isinstance(found, Explained) else found
