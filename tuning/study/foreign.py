"""What of a study is not vsajax' own: it is recorded with the study, and part of its hash."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from tuning.files.errors import Mistake
from tuning.files.toml import Table, refusal
from tuning.study.parts.base import parts_in
from tuning.study.plugins import SOURCE, Origin, is_installed, recorded_of
from tuning.study.population import Population, parse_failure
from tuning.study.registry import origin_of, origins_of

PLUGINS = "plugins"
"""The table of a study in which it is recorded: name and version by reference."""


def foreign_in(config: Table) -> dict[str, dict[str, str]]:
    """Return name and version of all that is foreign in a configuration, by reference; usually nothing.

    What only an option of a choice, or a value of a grid, brings in counts too.
    """
    found = [part.origin for part in parts_in(config)]
    found += [origin_of("kinds", str(getattr(config, "kind", "")))]
    found += [origin for tag in _chosen(config) for origin in origins_of(tag)]
    found += [origin_of("scores", name) for name in _scores(config)]
    return {origin.ref: recorded_of(origin) for origin in sorted(filter(None, found), key=_ref)}


def require_recorded(recorded: Any, present: Mapping[str, Mapping[str, str]]) -> None:
    """Refuse a study that was made with another version of something foreign than it uses here.

    Args:
        recorded: its table `plugins`.
        present: what it uses here.

    Raises:
        PydanticCustomError: see `files.toml.refusal`.
    """
    if not isinstance(recorded, dict) or not all(map(_is_record, recorded.values())):
        fix = 'needs a table a module: "my_springs:AirSpring" = { name = "my-springs", version = "1.0" }'
        raise refusal(PLUGINS, f"got {recorded!r:.80}", f"{fix}; or remove it")
    for ref in recorded.keys() & present.keys():
        was, found = recorded[ref], present[ref]
        if was != found:
            problem = f"says {was['name']} {was['version']}; here is {found['name']} {found['version']}"
            fix = f"install {was['name']} {was['version']}, or remove the table to go on with what is here"
            raise refusal(f"{PLUGINS}.{ref!r}", problem, fix)


def absent(recorded: Any, place: str) -> list[Mistake]:
    """Return which packages a study was made with that are not installed here.

    Args:
        recorded: its table `plugins`, if it has one.
        place: of that table, for errors.
    """
    records = recorded.values() if isinstance(recorded, dict) else ()
    made_with = {(one["name"], one["version"]) for one in records if _is_record(one)}
    return [
        Mistake(place, f"needs {name} {version}, which is not installed", "install it, if you trust it")
        for name, version in sorted(made_with)
        if not version.startswith(SOURCE) and not is_installed(name)
    ]


def _is_record(value: Any) -> bool:
    return isinstance(value, dict) and value.keys() == {"name", "version"} and _all_texts(value.values())


def _all_texts(values: Iterable[Any]) -> bool:
    return all(isinstance(value, str) for value in values)


def _ref(origin: Origin) -> str:
    return origin.ref


def _chosen(config: Table) -> Iterator[str]:
    """Return the tags that a study's choices and its grid put in place of its own."""
    tune, sweep = getattr(config, "tune", None), getattr(config, "sweep", None)
    for options in getattr(tune, "choices", {}).values():
        for settings in options.values():
            yield from _tags(settings)
    for path, axis in getattr(sweep, "grid", {}).items():
        if path.endswith(".type"):
            yield from (option for option in axis.options or () if isinstance(option, str))


def _tags(tables: Mapping[str, Any]) -> Iterator[str]:
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _tags(value)
        elif isinstance(value, str) and (key == "type" or key.endswith(".type")):
            yield value


def _scores(config: Table) -> Iterator[str]:
    """Return the scores that a study names."""
    tune, population = getattr(config, "tune", None), getattr(config, "population", None)
    if (objective := getattr(tune, "objective", None)) is not None:
        yield objective
    if isinstance(population, Population):
        yield from (parse_failure(name, text)[0] for name, text in population.failures.items())
