"""How much a plan may take, and refusing one that takes more, by its numbers and before anything is allocated."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from tuning.files.errors import input_error

MEMORY, HOURS, COMPILATION = "VSAJAX_MEMORY_GIB", "VSAJAX_HOURS", "VSAJAX_COMPILE_MINUTES"
"""Environment variables that replace the limits."""
_HOURS, _COMPILE_MINUTES = 168.0, 5.0
_UNKNOWN_MEMORY = 16 * 2**30
_CGROUP = Path("/sys/fs/cgroup/memory.max")
_LARGEST_EXACT = 10**15


class Limits(NamedTuple):
    """What no plan may exceed.

    Args:
        memory: [bytes]; by default all that this machine, or this process's share of it, has.
        seconds: of work; by default a week.
        compiling: of compilation [s]; by default five minutes.
    """

    memory: float
    seconds: float
    compiling: float


@dataclass(frozen=True)
class Need:
    """What a plan, or a part of one, takes.

    Args:
        place: what asks for it: file and key, or an option.
        amount: how much of what that is, e.g. "1e+12 samples".
        fix: the way out beside raising the limit.
        memory: [bytes].
        seconds: of work on all cores.
        compiling: seconds of compilation.
    """

    place: str
    amount: str
    fix: str
    memory: float = 0.0
    seconds: float = 0.0
    compiling: float = 0.0


@dataclass(frozen=True)
class Needs:
    """What the plans of a kind of study take that runs over no samples.

    Args:
        file: (study, place) -> what its own tables ask for, whichever command it is given to.
        scenario: what one scenario takes: of memory while it is scored beside others [bytes], and of time on one
            core [s].
    """

    file: Callable[[Any, str], list[Need]]
    scenario: tuple[float, float]


def limits() -> Limits:
    """Return the limits of this machine, or those that the environment gives.

    Raises:
        InputError: a variable of the environment is no positive number.
    """
    memory = _given(MEMORY, _memory_here() / 2**30) * 2**30
    return Limits(memory, _given(HOURS, _HOURS) * 3600.0, _given(COMPILATION, _COMPILE_MINUTES) * 60.0)


def require(*needs: Need) -> None:
    """Refuse what exceeds a limit.

    Raises:
        InputError: names the first that does, from which others may follow: how much it is, what it takes, and
            what raises the limit.
    """
    allowed = limits()
    for need in needs:
        _require_within(need, allowed)


def _require_within(need: Need, allowed: Limits) -> None:
    # NaN, of numbers beyond all bounds multiplied by 0, is beyond them too.
    exceeded = {
        MEMORY: not need.memory <= allowed.memory,
        HOURS: not need.seconds <= allowed.seconds,
        COMPILATION: not need.compiling <= allowed.compiling,
    }
    if not any(exceeded.values()):
        return
    taken = [f"about {in_bytes(need.memory)} of memory"] if need.memory else []
    taken += [f"{in_time(need.seconds)} of work"] if need.seconds else []
    taken += [f"{in_time(need.compiling)} of compilation"] if exceeded[COMPILATION] else []
    has = [f"{in_bytes(allowed.memory)} of memory"] if exceeded[MEMORY] else []
    has += [in_time(allowed.seconds)] if exceeded[HOURS] else []
    has += [f"{in_time(allowed.compiling)} of compilation"] if exceeded[COMPILATION] else []
    problem = f"{need.amount}: needs {', '.join(taken)}; allowed: {', '.join(has)}"
    raised = " and ".join(name for name, is_exceeded in exceeded.items() if is_exceeded)
    fix = f"{need.fix}; or raise the limit: set {raised} in the environment"
    raise input_error(need.place, problem, fix)


def number(count: float) -> float:
    """Return a whole number of any size as a float, infinite where it has more than 308 digits."""
    try:
        return float(count)
    except OverflowError:
        return math.inf


def product(*counts: float) -> float:
    """Return the product of whole numbers of any size as a float."""
    return math.prod(map(number, counts))


def in_count(count: float) -> str:
    """Return a count as people read it: all digits of a small one."""
    if math.isfinite(number(count)) and count < _LARGEST_EXACT and count == int(count):
        return f"{int(count):,}"
    return f"{number(count):.3g}" if math.isfinite(number(count)) else "more than 1e308"


def in_bytes(size: float) -> str:
    """Return bytes as people read them."""
    for unit, scale, least in (("TiB", 2**40, 1.0), ("GiB", 2**30, 0.1)):
        if not size < least * scale:
            return f"{size / scale:,.3g} {unit}" if size < 1e4 * scale else f"{size / scale:.2g} {unit}"
    return f"{size / 2**20:.0f} MiB"


def in_time(seconds: float) -> str:
    """Return a time as people read it."""
    units = (("years", 3.156e7), ("days", 86400.0), ("h", 3600.0), ("min", 60.0))
    name, scale = next(((n, s) for n, s in units if not seconds < 1.5 * s), ("s", 1.0))
    return f"{seconds / scale:.3g} {name}"


def _given(name: str, otherwise: float) -> float:
    text = os.environ.get(name, "").strip()
    if not text:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value > 0.0:
        raise input_error(name, f"got {text!r}; needs a positive number", "set it to one, or unset it")
    return value


def _memory_here() -> float:
    """Return the memory of this machine, or of the container that holds this process [bytes]."""
    try:
        found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    except (AttributeError, OSError, ValueError):
        found = [_UNKNOWN_MEMORY]
    # Without a container there is no such file; without a limit it reads "max".
    with contextlib.suppress(OSError, ValueError):
        found.append(int(_CGROUP.read_text(encoding="ascii")))
    return float(min(found))
