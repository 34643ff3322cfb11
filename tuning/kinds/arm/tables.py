"""The tables of a study that describe an arm; nothing here imports jax."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from tuning.files.text import Line
from tuning.files.toml import Table

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]

FARTHEST_DEG = 1e7
"""Beyond it sines lose digits; no joint turns so far."""


class Turn(Table):
    """A turn about an axis of the frame so far."""

    axis: Literal["x", "y", "z"]
    degrees: float


class Limited(Table):
    """A joint's range."""

    range_deg: Pair = Field(default_factory=lambda: [-180.0, 180.0])

    @model_validator(mode="after")
    def _ordered(self) -> Limited:
        if self.range_deg[0] >= self.range_deg[1]:
            raise ValueError(f"range_deg must be low, then high; got {self.range_deg}")
        if max(map(abs, self.range_deg)) > FARTHEST_DEG:
            raise ValueError(f"range_deg must lie within ±{FARTHEST_DEG:g}; got {self.range_deg}")
        return self


class Joint(Limited):
    """A revolute joint: where it is in the frame before, how it is turned, its axis."""

    offset: Vector3 = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    turns: list[Turn] = Field(default_factory=list)
    axis: Vector3

    @model_validator(mode="after")
    def _has_direction(self) -> Joint:
        if not 1e-6 <= math.hypot(*self.axis) <= 1e6:
            raise ValueError(f"axis must be a direction, of a length between 1e-6 and 1e6; got {self.axis}")
        return self


class DhJoint(Limited):
    """A joint by its Denavit–Hartenberg parameters."""

    a: float = 0.0
    alpha_deg: float = 0.0
    d: float = 0.0
    theta_deg: float = 0.0


class Tool(Table):
    """The hand in the last frame."""

    offset: Vector3 = Field(default_factory=lambda: [0.0, 0.0, 0.0])
    turns: list[Turn] = Field(default_factory=list)


class Arm(Table):
    """An arm, by one of: a URDF file and the tip's link, joints one by one, Denavit–Hartenberg parameters."""

    urdf: Line | None = None
    base: Line | None = None
    tip: Line | None = None
    joints: list[Joint] = Field(default_factory=list)
    dh: list[DhJoint] = Field(default_factory=list)
    convention: Literal["standard", "modified"] = "standard"
    tool: Tool = Tool()
    pose_deg: list[float] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_source(self) -> Arm:
        given = [name for name in ("urdf", "joints", "dh") if getattr(self, name)]
        if len(given) != 1:
            raise ValueError(f"needs exactly one of preset, urdf, joints, dh; got {', '.join(given) or 'none'}")
        if self.urdf is None and (self.base is not None or self.tip is not None):
            raise ValueError("base and tip name links of a urdf; tables of joints have none: remove them")
        return self
