"""What there is to choose from: vsajax' own, what is installed, and where each of them comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tuning.terminal.following import start
from tuning.terminal.options import JSON, QUIET, emit

if TYPE_CHECKING:
    from tuning.study.registry import Listed, Registry


@click.command(epilog="Example: vsajax parts springs")
@click.argument("slot", required=False)
@JSON
@QUIET
def parts(slot: str | None, as_json: bool, quiet: bool) -> None:
    """List what a study or a command may name: per SLOT every tag, its numbers with their ranges, whose it is.

    The slots are places in a study; the registries kinds, scores, formats and papers are open in the same way.
    Packages that are installed with entry points for them are imported to be listed.
    """
    from tuning.files.errors import input_error

    registries = _registries()
    if slot is not None and slot not in registries:
        raise input_error(f"SLOT: got {slot!r}", "is none", f"allowed: {', '.join(registries)}")
    chosen = registries if slot is None else {slot: registries[slot]}
    found = {name: {one.tag: _described(one) for one in _listed(registry)} for name, registry in chosen.items()}
    emit(found, as_json=as_json, quiet=quiet, text=lambda: "\n".join(_lines(found)), following=start)


def _registries() -> dict[str, Registry[Any]]:
    from tuning.exports.formats.registry import FORMATS
    from tuning.papers import PAPERS
    from tuning.study.kinds import KINDS
    from tuning.study.parts.catalog import SLOTS
    from tuning.study.scores import SCORES

    return SLOTS | {one.name: one for one in (KINDS, SCORES, FORMATS, PAPERS)}


def _listed(registry: Registry[Any]) -> list[Listed]:
    # A tag that somebody else claims too is told of beside its owner, not in its place.
    return [
        one._replace(tag=f"{one.tag} (refused)") if one.problem and one.entry is None else one
        for one in registry.listed()
    ]


def _described(one: Listed) -> dict[str, Any]:
    """Return what there is to say of an entry, for machines."""
    from tuning.study.describing import numbers_of, summary_of

    told: dict[str, Any] = {"origin": "vsajax" if one.origin is None else one.origin.said}
    if one.origin is not None:
        told["ref"] = one.origin.ref
    if one.problem:
        return told | {"problem": one.problem}
    return told | {"summary": summary_of(one.entry), "numbers": numbers_of(one.entry)}


def _lines(found: dict[str, dict[str, dict[str, Any]]]) -> list[str]:
    lines: list[str] = []
    for name, entries in found.items():
        width = max(map(len, entries), default=0)
        lines += ["", name]
        for tag, told in entries.items():
            whose = "" if told["origin"] == "vsajax" else f"  [{told['origin']}: {told['ref']}]"
            lines.append(f"  {tag:<{width}}  {told.get('summary') or told.get('problem', '')}{whose}")
            lines += [f"  {'':<{width}}    {number['said']}" for number in told.get("numbers", {}).values()]
    return lines[1:]
