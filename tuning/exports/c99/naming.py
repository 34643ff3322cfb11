"""Names that C takes."""

from __future__ import annotations

import re

_KEYWORDS = {
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
    "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
    "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool",
    "true", "false", "real",
}  # fmt: skip


RESERVED = _KEYWORDS | {
    "abs", "acos", "answer", "asin", "atan", "ceil", "clock", "cos", "cosh", "div", "errno",
    "exit", "exp", "fabs", "floor", "fmod", "free", "gamma", "harness", "index", "instance", "j0", "j1", "jn",
    "linux", "log", "main", "malloc", "params", "pow", "prepare", "process", "rand", "read", "remainder",
    "reset", "sample", "self", "sensors", "signal", "sin", "sinh", "sqrt", "stdin", "stdout", "tan", "tanh",
    "time", "unix", "variable", "write", "y0", "y1", "yn",
}  # fmt: skip
"""Names that a program must not have: those of the language, its library, and the files around it."""


def identifier(name: str) -> str:
    """Return a name that C takes."""
    clean = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"{clean}_" if clean in _KEYWORDS else clean
