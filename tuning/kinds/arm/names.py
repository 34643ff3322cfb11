"""Names of joints and links as people read them."""

from __future__ import annotations

from collections.abc import Sequence

from tuning.files.errors import printable


def numbered(count: int) -> tuple[str, ...]:
    """Return the names of joints that have none of their own."""
    return tuple(f"joint_{i + 1}" for i in range(count))


def shown(name: str) -> str:
    """Return a name as it can be printed; of none, an empty pair of quotes."""
    return printable(name) or "''"


def listed(names: Sequence[str], most: int = 24) -> str:
    """Return names in one line, the first of very many."""
    told = ", ".join(map(shown, names[:most]))
    return f"{told}, … ({len(names)} in all)" if len(names) > most else told
