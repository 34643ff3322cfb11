"""Names of members and variables in C: those of the source, unless C has a use for them."""

from __future__ import annotations

import re

from tuning.exports.names import words


def identifier(name: str) -> str:
    """Return a name that C takes."""
    clean = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"{clean}_" if clean in words("keywords") or clean == "real" else clean
