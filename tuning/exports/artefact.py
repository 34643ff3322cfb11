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
    """

    files: dict[str, str | bytes]
    check: str
    usage: str
    figures: dict[str, Any] = field(default_factory=dict)


Writer = Callable[[Subject], Artefact]
