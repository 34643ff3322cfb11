"""The stiffness design of an arm as it runs on a robot: joint positions in, joint stiffnesses and torques out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path as File

import jax.numpy as jnp
import numpy as np

from tuning.exports.deployable import Deployable
from tuning.exports.layout import Path
from tuning.exports.ranges import Order, Range
from tuning.files.errors import input_error
from tuning.kinds.arm.bench import ArmBench, build_bench, pose_of
from tuning.kinds.arm.names import listed, numbered
from tuning.kinds.arm.study import ArmStudy
from tuning.study.base import FOLDER, Base
from tuning.study.parts.base import Part
from vsajax.arms import task_scale
from vsajax.control import ArmController, ArmReading

_RATE = 100.0
"""Cycles a second of the golden recording; the step knows no time."""
_DRAWS = 4096
_UNIT, _METRES, _STIFFNESS = Range(-1.0 - 1e-9, 1.0 + 1e-9), Range(-1e3, 1e3), Range(1e-6, 1e9)
"""Entries of directions and rotations, as rounding leaves them; places of joints; stiffnesses."""
_RANGES = {
    "offsets": _METRES,
    "rotations": _UNIT,
    "axes": _UNIT,
    "tool_offset": _METRES,
    "tool_rotation": _UNIT,
    "bounds": _STIFFNESS,
    "length": Range(1e-6, 1e3),
    "max_active_stiffness": _STIFFNESS,
    "motor_inertia": Range(1e-9, 1e6),
    "posture_stiffness": Range(0.0, 1e9),
    "damping_ratio": Range(0.0, 1e6),
}


class DeployableDesigner(Deployable):
    """Both stages of the design of one arm, and the impedance controller that goes with them.

    Args:
        study: of the arm.
        place: its file, for errors.
    """

    noun = "designer"

    def __init__(self, study: ArmStudy, place: str):
        self.study = study
        self.bench: ArmBench = build_bench(study, place)
        urdf = study.arm.urdf
        # What is exported is read beside what it names.
        self._urdf = None if urdf is None else study.folder / urdf

    @property
    def config(self) -> ArmStudy:
        """The study; a URDF is named without its folder."""
        if self._urdf is None:
            return self.study
        named = self.study.arm.model_copy(update={"urdf": self._urdf.name})
        provenance = {key: value for key, value in self.study.provenance.items() if key != FOLDER}
        return self.study.model_copy(update={"arm": named, "provenance": provenance})

    @property
    def companions(self) -> dict[str, bytes]:
        """The URDF, where the study names one."""
        return {} if self._urdf is None else {self._urdf.name: self._urdf.read_bytes()}

    @property
    def title(self) -> str:
        """What it is, for people; joints with names of their own are named in the order of every array."""
        own = f" ({listed(self.joints)}, in this order)" if self.joints else ""
        return f"Cartesian stiffness of an arm with {self.bench.arm.joints} joints{own}, in every cycle"

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints' own names, e.g. those of a URDF; none where they have only numbers."""
        names = self.bench.names
        return () if names == numbered(len(names)) else names

    @property
    def joint_count(self) -> int:
        """How many joints the arm has."""
        return self.bench.arm.joints

    @property
    def parts(self) -> Mapping[tuple[str, ...], Part]:
        """None: an arm's tables are not those of the module."""
        return {}

    def range(self, path: Path) -> Range:
        """Return where a parameter may lie; that of kinematics is any."""
        return next((_RANGES[key] for key in reversed(path) if key in _RANGES), Range())

    @property
    def orders(self) -> tuple[Order, ...]:
        """A joint's lower bound must not exceed its upper one."""
        return (Order(("bounds", "lower"), ("bounds", "upper"), is_strict=False),)

    def build(self) -> ArmController:
        """Return the controller of the arm."""
        bench = self.bench
        return ArmController(bench.arm, bench.bounds, bench.designer, bench.length)

    @property
    def sample(self) -> ArmReading:
        """Positions, velocities, posture and desired stiffness."""
        still = jnp.zeros(self.bench.arm.joints)
        return ArmReading(still, still, still, jnp.asarray(self._stiffness))

    @property
    def sample_time(self) -> None:
        """Any will do."""

    @property
    def _stiffness(self) -> np.ndarray:
        return np.asarray(self.study.task.matrix())

    def record(self, path: File) -> tuple[dict[str, np.ndarray], str]:
        """Refuse: a joint's recording has none of an arm's signals."""
        raise input_error(
            path, "an arm is not recorded joint by joint", "leave --recording out: its golden recording is a path"
        )

    def simulate(self, seconds: float) -> tuple[dict[str, np.ndarray], str]:
        """Return a path through the joints' ranges, and a desired stiffness that changes on the way.

        It begins and ends at the study's pose, and goes through the most singular of many poses. The last cycles
        ask for what must be refused, and for what no controller can give.
        """
        count = max(round(seconds * _RATE), 8) + 1
        time = np.arange(count) / _RATE
        position, velocity = self._path(time)
        wave = np.sin(2.0 * np.pi * 3.0 * time / time[-1])
        posture = position - 0.02 * wave[:, None] * np.cos(np.arange(position.shape[1]))
        factors = 1.0 + 0.5 * wave[:, None, None]
        stiffness = factors * self._stiffness
        stiffest = float(self.bench.designer.max_active_stiffness)
        stiffness[-4], stiffness[-3] = -self._stiffness, np.nan
        units = np.asarray(task_scale(self.bench.length))[: self.study.task.size]
        stiffness[-2] = np.diag(2.0 * stiffest * units**2)
        columns = {"time": time, "position": position, "velocity": velocity, "posture": posture}
        return columns | {"stiffness": stiffness}, f"a path of {self.study.name!r} past a singular pose"

    def _path(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s], at rest in every pose that the path leads to."""
        rng = np.random.default_rng(self.study.seed)
        pose = np.asarray(pose_of(self.study, self.bench))
        drawn = self.bench.draw(rng, _DRAWS)
        units = np.asarray(task_scale(self.bench.length))[:, None]
        jacobians = units * np.asarray(jnp.vectorize(self.bench.arm.jacobian, signature="(n)->(m,n)")(drawn))
        spread = np.linalg.svd(jacobians[:, : self.study.task.size], compute_uv=False)
        most_singular = drawn[np.argmin(spread[:, -1] / spread[:, 0])]
        poses = np.stack([pose, *drawn[:3], most_singular, drawn[3], pose])
        leg = time / time[-1] * (len(poses) - 1)
        last = np.minimum(leg.astype(int), len(poses) - 2)
        share = (leg - last)[:, None]
        way = poses[last + 1] - poses[last]
        rate = (len(poses) - 1) / time[-1]
        position = poses[last] + (3.0 * share**2 - 2.0 * share**3) * way
        return position, 6.0 * share * (1.0 - share) * way * rate


def deployable_of(config: Base, place: str) -> DeployableDesigner:
    """Return the designer of an arm's study; `place` is its file."""
    assert isinstance(config, ArmStudy)
    return DeployableDesigner(config, place)
