"""What a kind of study says of the numbers that a search has found, beyond their scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tuning.pictures.page import Table
from tuning.study.base import Study
from tuning.study.kinds import kind_of


@dataclass(frozen=True)
class Finding:
    """What there is to say of the numbers of a study.

    Args:
        facts: for machines, beside what every search reports; tables of the same name are joined.
        provenance: the same in `best.toml`.
        notes: on what was read.
        table: for people; `None` where there is none.
        sentences: for people.
    """

    facts: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    table: Table | None = None
    sentences: list[str] = field(default_factory=list)


def find(study: Study, best: Study) -> Finding:
    """Return what the kind of a study says of the best that a search over it has found."""
    make = kind_of(study).finding
    return Finding() if make is None else make.load()(study, best)


def joined(told: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return two mappings as one, tables that both have joined."""
    both = {name: {**told[name], **own[name]} for name in own if isinstance(own[name], Mapping) and name in told}
    return {**told, **own, **both}
