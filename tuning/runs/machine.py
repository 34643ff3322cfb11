"""Switching jax on for the lab: double precision, one host device a core, a compile cache on disk."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

_DEVICES = "--xla_force_host_platform_device_count"
_VECTORS = "--xla_cpu_prefer_vector_width"
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


def with_lab_flags(flags: str) -> str:
    """Return XLA's `flags` and those of the lab that they do not give themselves."""
    # Vectors of eight numbers where the processor has them: XLA's own choice is four. A tenth to a quarter faster.
    wanted = {_DEVICES: str(usable_cores()), _VECTORS: "512", _LLVM: _LLVM_OPTIONS}
    missing = (f"{flag}={value}" for flag, value in wanted.items() if flag not in flags)
    return " ".join([flags, *missing]).strip()


def start_jax() -> None:
    """Configure jax for the lab; call it before anything computes.

    A host device a core must be asked for before jax' first computation. What the user's XLA_FLAGS give is kept.
    """
    os.environ["XLA_FLAGS"] = with_lab_flags(os.environ.get("XLA_FLAGS", ""))
    import jax

    jax.config.update("jax_enable_x64", True)
    if not sys.flags.dev_mode:
        heal_cache(cache_folder())
        jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)


def heal_cache(folder: Path) -> None:
    """Empty the compile cache in `folder` once jax cannot read it, and say so in one line.

    Without this, jax warns of every program, at every run: it never replaces an entry that is damaged.
    """
    show, is_told = warnings.showwarning, False

    def show_once(message: Any, *arguments: Any, **options: Any) -> None:
        nonlocal is_told
        if "persistent compilation cache" not in str(message):
            show(message, *arguments, **options)
        elif not is_told:
            is_told = True
            print(f"note: the compile cache {folder} {_emptied(folder)}", file=sys.stderr)

    warnings.showwarning = show_once


def _emptied(folder: Path) -> str:
    """Remove every program in the cache, and return what to tell."""
    try:
        for entry in folder.iterdir():
            if entry.name.endswith(("-cache", "-atime")):
                entry.unlink(missing_ok=True)
    except OSError as error:
        return f"cannot be used ({error.strerror}); programs are compiled anew. VSAJAX_CACHE names another folder"
    return "was damaged and has been emptied; programs are compiled once more"
