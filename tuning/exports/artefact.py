"""What a format makes of a configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from tuning.exports.deployable import Deployable
from tuning.exports.golden import Golden
from tuning.exports.program import StepProgram


@dataclass(frozen=True)
class Subject:
    """What is exported.

    Args:
        deployable: where it comes from.
        program: its step.
        golden: its golden recording.
        banner: a line that says where an artefact comes from.
        identity: a hash of the configuration.
    """

    deployable: Deployable
    program: StepProgram
    golden: Golden
    banner: str
    identity: str


@dataclass(frozen=True)
class Artefact:
    """Files of one format.

    Args:
        files: contents by name, the artefact first.
        check: the module of `checks` that checks them.
        usage: how to use them: Markdown.
        figures: numbers for the manifest.
        helpers: further modules of `checks` that the check imports.
    """

    files: dict[str, str | bytes]
    check: str
    usage: str
    figures: dict[str, Any] = field(default_factory=dict)
    helpers: tuple[str, ...] = ()

    @property
    def scripts(self) -> dict[str, str]:
        """The check that travels with them: file names, and the modules of `checks` that they are."""
        return {"check.py": self.check, **{f"{name}.py": name for name in ("checking", *self.helpers)}}


Writer = Callable[[Subject], Artefact]
