"""Units as exponents of the base units of the SI."""

from __future__ import annotations

import re
from collections import Counter

_BASE: dict[str, dict[str, int]] = {
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Hz": {"s": -1},
    "1": {},
}
_POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_TOKEN = re.compile(r"(kg|rad|Hz|[msAKNJWV1])([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]*)")


def base_units(unit: str) -> dict[str, int] | None:
    """Return a unit such as "N·m·s/rad" as exponents of base units, or `None` where it is not one."""
    exponents: Counter[str] = Counter()
    for n, part in enumerate(unit.split("/")):
        for token in part.split("·"):
            match = _TOKEN.fullmatch(token.strip())
            if match is None:
                return None
            power = int(match[2].translate(_POWERS) or 1) * (1 if n == 0 else -1)
            for base, exponent in _BASE[match[1]].items():
                exponents[base] += exponent * power
    return {base: exponent for base, exponent in exponents.items() if exponent}
