"""The configurations that can be exported: a joint's study or estimator, and the study of an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tuning.files.errors import InputError
from tuning.files.toml import read_toml, validate
from tuning.kinds.arm.study import ArmStudy, check_task, is_arm_study, load_arm_study
from tuning.study.loading import Base, load_config, parse_config

Exportable = Base | ArmStudy


def load_exportable(path: Path, settings: Sequence[str] = ()) -> Exportable:
    """Return the configuration in a TOML file, with `a.b=value` settings applied before it is validated.

    A sweep or a search that the settings have made impossible is left out: an export makes neither.

    Raises:
        InputError: lists every mistake with its path.
    """
    if is_arm_study(read_toml(path)):
        return load_arm_study(path, list(settings))
    return load_config(path, settings, unused=("sweep", "tune"))


def parse_exportable(tables: Mapping[str, Any], place: str) -> Exportable:
    """Return the configuration in tables, as `resolved` writes them; `place` names their source in errors."""
    if not is_arm_study(dict(tables)):
        return parse_config(tables, place)
    study = validate(ArmStudy, dict(tables), place)
    mistakes = check_task(study.task, place)
    if mistakes:
        raise InputError(*mistakes)
    return study
