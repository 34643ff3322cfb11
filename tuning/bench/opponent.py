"""The C opponent: found, compiled once per machine and source, called through ctypes."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tuning.files.errors import input_error
from tuning.runs.machine import cache_folder, usable_cores

_INSTALLED = Path(__file__).parents[1] / "benchmarks"
BENCHMARKS = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[2] / "benchmarks"
"""In a wheel the folder lies in the package, in a checkout beside it."""
SOURCE = BENCHMARKS / "baseline.c"
FLAGS = ("-std=gnu99", "-O3", "-march=native", "-ffast-math", "-fPIC", "-pthread")
LINKING = ("-shared", "-pthread", "-lm")
"""Without -ffast-math, with which gcc links start-up code that flushes subnormal numbers in the whole process."""
_COMPILERS = ("gcc", "cc", "clang")
_DOUBLES = ctypes.POINTER(ctypes.c_double)


def find_compiler() -> str:
    """Return the C compiler: `CC` of the environment, else the first that is installed.

    Raises:
        InputError: there is none.
    """
    asked = os.environ.get("CC")
    for name in (asked,) if asked else _COMPILERS:
        found = shutil.which(name)
        if found is not None:
            return found
    looked = f"CC={asked}" if asked else ", ".join(_COMPILERS)
    raise input_error(
        "--against c",
        f"no C compiler was found (looked for {looked})",
        "install gcc, name a compiler in CC, or leave --against out",
    )


def compile_opponent(source: Path = SOURCE) -> Path:
    """Return the opponent's shared library, compiled unless the cache holds it.

    Raises:
        InputError: there is no compiler, or it refuses the source.
    """
    compiler = find_compiler()
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False).stdout
    # -march=native: a library of another processor must not be taken from a cache that machines share.
    parts = (source.read_bytes(), version.encode(), " ".join(FLAGS + LINKING).encode(), processor().encode())
    digest = hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]
    library = cache_folder() / f"baseline-{digest}.so"
    if library.is_file():
        return library
    library.parent.mkdir(parents=True, exist_ok=True)
    unfinished = library.with_suffix(f".{os.getpid()}.tmp")
    compiled = unfinished.with_suffix(".o")
    steps = (
        [compiler, *FLAGS, "-c", str(source), "-o", str(compiled)],
        [compiler, str(compiled), "-o", str(unfinished), *LINKING],
    )
    try:
        for words in steps:
            ended = subprocess.run(words, capture_output=True, text=True, check=False)
            if ended.returncode != 0:
                said = f"{compiler} failed: {ended.stderr.strip()}"
                raise input_error(str(source), said, "try another compiler: CC=gcc")
        unfinished.replace(library)
    finally:
        compiled.unlink(missing_ok=True)
    return library


def processor() -> str:
    """Return the processor's name and features, as far as the system tells."""
    import platform

    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    wanted = ("model name", "flags", "Features", "CPU part")
    lines = {line for line in text.splitlines() if line.startswith(wanted)}
    return "\n".join(sorted(lines)) or platform.machine()


@dataclass(frozen=True)
class Opponent:
    """The compiled opponent.

    Args:
        library: from `compile_opponent`.
        threads: over which it shares its lanes out; every usable core by default.
    """

    library: Path
    threads: int = 0

    @cached_property
    def _functions(self) -> ctypes.CDLL:
        return ctypes.CDLL(str(self.library))

    @property
    def cores(self) -> int:
        """Return the number of threads."""
        return self.threads or usable_cores()

    def call(
        self,
        name: str,
        lanes: Sequence[int],
        samples: Sequence[int],
        numbers: Sequence[float | np.ndarray],
        shape: tuple[int, ...],
    ) -> np.ndarray:
        """Run a kernel and return its result.

        Args:
            name: of the function in the source.
            lanes: its numbers of lanes, before the number of threads.
            samples: its lengths, after it.
            numbers: its numbers and contiguous double arrays, in order.
            shape: of the result.

        Raises:
            MemoryError: the kernel ran out of memory.
        """
        result = np.zeros(shape)
        arguments = [*map(ctypes.c_long, lanes), ctypes.c_int(self.cores), *map(ctypes.c_long, samples)]
        arguments += [_pointer(x) if isinstance(x, np.ndarray) else ctypes.c_double(x) for x in numbers]
        if getattr(self._functions, name)(*arguments, _pointer(result)):
            raise MemoryError(f"the C kernel {name} ran out of memory")
        return result

    def flops_of_peak(self, rounds: int) -> float:
        """Return the floating-point operations of one run of `peak` on every thread."""
        return float(self._functions.flops_per_round()) * rounds * self.cores


def load_opponent(threads: int = 0) -> Opponent:
    """Return the opponent, compiled where needed.

    Raises:
        InputError: there is no compiler, or it refuses the source.
    """
    return Opponent(compile_opponent(), threads)


def _pointer(array: np.ndarray) -> ctypes._Pointer[ctypes.c_double]:
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise TypeError(f"the opponent takes contiguous float64 arrays; got {array.dtype}, {array.strides}")
    return array.ctypes.data_as(_DOUBLES)
