"""Names that C takes."""

from __future__ import annotations

import re

_KEYWORDS = {
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
    "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
    "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool",
    "true", "false", "real",
}  # fmt: skip


def identifier(name: str) -> str:
    """Return a name that C takes."""
    clean = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"{clean}_" if clean in _KEYWORDS else clean
