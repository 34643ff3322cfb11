"""Switching jax on for the lab: double precision, one host device a core, a compile cache on disk."""

from __future__ import annotations

import os
import sys
from pathlib import Path

_DEVICES = "--xla_force_host_platform_device_count"
_LLVM = "--xla_backend_extra_options"
_LLVM_OPTIONS = "-unroll-full-max-count=8,-post-RA-scheduler=0"
"""LLVM unrolls short inner loops, such as those over the lanes of a chunk, into scalar code before it would
vectorise them; fewer unrolled turns leave them to the vectoriser (estimator, d = 18: a fifth faster). Its second
scheduler looks at every pair of loads and stores of a sample: a tenth of LLVM's time (perf), and no gain."""


def usable_cores() -> int:
    """Return how many cores this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """Return where compiled programs are kept between runs."""
    base = os.environ.get("VSAJAX_CACHE") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "vsajax"


def start_jax() -> None:
    """Configure jax for the lab; call it before anything computes.

    A host device a core must be asked for before jax' first computation. What the user's XLA_FLAGS give is kept.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    wanted = {_DEVICES: str(usable_cores()), _LLVM: _LLVM_OPTIONS}
    missing = (f"{flag}={value}" for flag, value in wanted.items() if flag not in flags)
    os.environ["XLA_FLAGS"] = " ".join([flags, *missing]).strip()
    import jax

    jax.config.update("jax_enable_x64", True)
    if not sys.flags.dev_mode:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
