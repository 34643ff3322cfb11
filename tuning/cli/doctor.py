"""What this installation is and runs on."""

from __future__ import annotations

import click

from tuning.terminal.following import start
from tuning.terminal.options import JSON, QUIET, emit


@click.command(epilog="Example: vsajax doctor")
@JSON
@QUIET
def doctor(as_json: bool, quiet: bool) -> None:
    """Print versions, devices, cores, precision, caches and optional packages."""
    from importlib import util

    from tuning.runs.machine import cache_folder, start_jax, usable_cores

    start_jax()
    import jax

    from tuning.runs.manifest import versions

    extras = ("dask", "submitit", "optuna", "SALib", "fmpy", "h5py", "rosbags")
    facts = {
        "ok": bool(jax.config.jax_enable_x64),
        "versions": versions(),
        "backend": jax.default_backend(),
        "devices": [str(device) for device in jax.local_devices()],
        "cores": usable_cores(),
        "float64": bool(jax.config.jax_enable_x64),
        "compile_cache": str(cache_folder()),
        "extras": {name: util.find_spec(name) is not None for name in extras},
    }
    lines = [f"{name:<14} {version}" for name, version in versions().items()]
    lines += [
        f"{'devices':<14} {', '.join(facts['devices'])} ({facts['backend']})",
        f"{'cores':<14} {facts['cores']}",
        f"{'precision':<14} {'float64' if facts['float64'] else 'float32 (unsafe)'}",
        f"{'compile cache':<14} {facts['compile_cache']}",
        f"{'extras':<14} " + ", ".join(f"{n} {'yes' if has else 'no'}" for n, has in facts["extras"].items()),
    ]
    emit(facts, as_json=as_json, quiet=quiet, text="\n".join(lines), following=start)
