"""Reading studies: one TOML file that says what is simulated, driven, measured, estimated, scored and tuned.

Nothing here imports jax: `vsajax check` answers at once. A tuned configuration is a study too, with a
`[provenance]` table; for a real log a `Config`, without a joint, is enough.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from tuning.files.errors import InputError
from tuning.files.kinds import CONFIG, STUDY, FileKind, kind_of, require_kind
from tuning.files.tables import put, with_settings
from tuning.files.toml import read_toml
from tuning.study.base import Base, Config, Search, Study, Sweep, Tune, resolved
from tuning.study.kinds import kind_in, study_files
from tuning.study.structures import check_whole


def load_study(path: Path, settings: Sequence[str] = (), *, unused: Collection[Search] = ()) -> Study:
    """Return the study in a TOML file, with `a.b=value` settings applied before it is validated.

    Args:
        path: the file.
        settings: changes.
        unused: searches that the caller never makes; they need not fit the rest of the study, see `parse_study`.

    Raises:
        InputError: lists every mistake with its path.
    """
    return parse_study(with_settings(read_toml(path), settings), str(path), unused=unused)


def load_config(path: Path, settings: Sequence[str] = (), *, unused: Collection[Search] = ()) -> Study | Config:
    """Return the study, or the estimator alone, in a TOML file; arguments as those of `load_study`.

    Raises:
        InputError: lists every mistake with its path.
    """
    config = parse(with_settings(read_toml(path), settings), str(path), CONFIG, *study_files(), unused=unused)
    assert isinstance(config, Study | Config)
    return config


def load(path: Path, settings: Sequence[str], *wanted: FileKind, unused: Collection[Search] = ()) -> Base:
    """Return the configuration in a TOML file that may be of several kinds; see `parse`."""
    return parse(with_settings(read_toml(path), settings), str(path), *wanted, unused=unused)


def parse(data: Mapping[str, Any], place: str, *wanted: FileKind, unused: Collection[Search] = ()) -> Base:
    """Return a configuration from its tables.

    Args:
        data: the tables.
        place: their source, for errors.
        wanted: what the file may be.
        unused: as of `parse_study`.

    Raises:
        InputError: lists every mistake with its path.
    """
    require_kind(data, place, *wanted)
    file = kind_of(data)
    if file is None:
        file = CONFIG if CONFIG in wanted else wanted[0]
    if file is CONFIG:
        kind_in(data, place, STUDY)
        return Config.parsed(data, place)
    return _parse(data, place, file, unused)


def parse_study(data: Mapping[str, Any], place: str, *, unused: Collection[Search] = ()) -> Study:
    """Return a study of something that is scored from its tables.

    Args:
        data: the tables.
        place: their source, for errors.
        unused: searches that the caller never makes. Where one no longer fits the rest of the study (a range
            reaches beyond a limit that was changed), the study is returned without them instead of refused.

    Raises:
        InputError: lists every mistake with its path.
    """
    study = parse(data, place, *study_files(), unused=unused)
    assert isinstance(study, Study)
    return study


def _parse(data: Mapping[str, Any], place: str, file: FileKind, unused: Collection[Search]) -> Base:
    tables: type[Base] = kind_in(data, place, file).tables.load()
    study = tables.parsed(data, place)
    if not isinstance(study, Study):
        mistakes = list(study.mistakes(place))
        if mistakes:
            raise InputError(*mistakes)
        return study
    try:
        check_whole(study, place)
    except InputError:
        lean = _without(study, unused)
        if lean == study:
            raise
        check_whole(lean, place)
        return lean
    return study


def _without(study: Study, searches: Collection[Search]) -> Study:
    """Return a study that does not say what some searches vary, nor what they minimise."""
    empty = {"sweep": Sweep(), "tune": Tune(objective=study.objectives[0])}
    return study.model_copy(update={name: empty[name] for name in searches})


def with_numbers(config: Base, values: Mapping[str, float], place: str) -> Study:
    """Return the study with numbers replaced, validated anew."""
    tables = resolved(config)
    for path, value in values.items():
        put(tables, path.split("."), value)
    return parse_study(tables, place)
