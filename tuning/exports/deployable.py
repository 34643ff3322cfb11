"""What can leave the lab, whatever it is: a step over samples, its numbers, and signals to try it on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path as File
from typing import Any, ClassVar

import numpy as np

from tuning.exports.layout import Path
from tuning.exports.names import identifier_of
from tuning.exports.program import StepProgram, program_of
from tuning.exports.ranges import Limits, Order, Range, orders_of, range_of
from tuning.files.errors import InputError, input_error
from tuning.logs.reading import read_recording
from tuning.study.base import Base
from tuning.study.kinds import exported_files, kind_of
from tuning.study.loading import load
from tuning.study.parts.base import Part


class Deployable(ABC):
    """A module with `init(sample)` and `step(state, sample)`, and the configuration that describes it.

    The formats, the manifest and the golden recording know nothing else of what they are made from.
    """

    noun: ClassVar[str]
    """What it is, in a word."""

    @property
    @abstractmethod
    def config(self) -> Base:
        """The configuration."""

    @property
    @abstractmethod
    def title(self) -> str:
        """What it is, for people."""

    @property
    @abstractmethod
    def parts(self) -> Mapping[tuple[str, ...], Part]:
        """The tables of its numbers, each with its path in the module."""

    @abstractmethod
    def build(self) -> Any:
        """Return what has `init` and `step`."""

    @property
    @abstractmethod
    def sample(self) -> Any:
        """A sample with the signals that it reads."""

    @property
    @abstractmethod
    def sample_time(self) -> float | None:
        """What it was made for [s]; `None` where any will do."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints' own names, from the base on; none where nothing names them."""
        return ()

    @property
    def joint_count(self) -> int:
        """How many joints there are."""
        return 1

    @property
    def needs_regular_clock(self) -> bool:
        """Whether it takes no other sample time."""
        return False

    @abstractmethod
    def simulate(self, seconds: float) -> tuple[dict[str, np.ndarray], str]:
        """Return `time` and the signals of a simulation, and where they come from, for people.

        Raises:
            InputError: nothing can be simulated.
        """

    def record(self, path: File) -> tuple[dict[str, np.ndarray], str]:
        """Return `time` and the signals of the user's recording, and what it is called.

        Raises:
            InputError: it cannot be read, or nothing like it can be recorded.
        """
        return dict(read_recording(path, kind=self.config.kind).columns), path.name

    @property
    def companions(self) -> dict[str, bytes]:
        """Files that its configuration names, by their names."""
        return {}

    def range(self, path: Path) -> Range:
        """Return where the parameter at a path may lie."""
        return range_of(self.parts, path)

    @property
    def orders(self) -> tuple[Order, ...]:
        """Which numbers must lie below which others."""
        return tuple(orders_of(self.parts))

    def limits(self, paths: list[Path]) -> Limits:
        """Return where the parameters at some paths may lie; an order of what is frozen is kept by itself."""
        orders = tuple(one for one in self.orders if {one.lower, one.upper} <= set(paths))
        return Limits(tuple(self.range(path).practical for path in paths), orders)

    @cached_property
    def module(self) -> Any:
        """What has `init` and `step`."""
        return self.build()

    def program(self, name: str | None = None) -> StepProgram:
        """Return the step, traced.

        Args:
            name: of all that is generated; by default that of the configuration, see `names.identifier_of`.

        Raises:
            Untraceable: it cannot leave Python.
        """
        title = f"{self.config.name}: {self.title}"
        own = identifier_of(self.config.name) if name is None else name
        return program_of(self.module, self.sample, name=own, title=title, limits=self.limits)


def load_deployable(path: File, settings: Sequence[str] = ()) -> Deployable:
    """Return what the configuration in a TOML file is exported as, with `a.b=value` settings applied first.

    A sweep or a search that the settings have made impossible is left out: an export makes neither.

    Raises:
        InputError: lists every mistake with its path.
    """
    return deployable_of(load(path, settings, *exported_files(), unused=("sweep", "tune")), str(path))


def deployable_of(config: Base, place: str) -> Deployable:
    """Return what a configuration is exported as: its estimator, its controller, or an arm's designer.

    Raises:
        InputError: it has none, or one that no robot can run.
    """
    make = kind_of(config).deployable
    if make is None:
        raise nothing_to_export(config, place)
    return make.load()(config, place)


def nothing_to_export(config: Base, place: str) -> InputError:
    """Return the error of a configuration without a part that runs on a robot."""
    return input_error(
        place,
        f"kind {config.kind!r} has nothing to export",
        "name a study or configuration with [estimator], a damping study with [controller], or an arm's study",
    )
