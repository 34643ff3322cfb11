"""The `vsajax` command. Commands import what they need when they run: `--help` never waits for jax."""

from tuning.cli.main import main

__all__ = ["main"]
