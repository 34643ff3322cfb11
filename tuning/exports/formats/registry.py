"""The formats by name."""

from __future__ import annotations

from importlib import import_module

from tuning.exports.artefact import Writer

FORMATS = {
    "toml": ("config", "write_toml"),
    "json": ("config", "write_json"),
    "c99": ("c99", "write_c99"),
    "fmi2": ("fmi", "write_fmi2"),
    "fmi3": ("fmi", "write_fmi3"),
    "ros2": ("ros2", "write_ros2"),
    "mat": ("mat", "write_mat"),
    "stablehlo": ("stablehlo", "write_stablehlo"),
}
"""Module and function of each format; imported when asked for."""


def writer_of(target: str) -> Writer:
    """Return the function that writes a format."""
    module, name = FORMATS[target]
    return getattr(import_module(f"tuning.exports.formats.{module}"), name)
