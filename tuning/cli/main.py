"""The command group, and how each kind of ending becomes an exit code."""

from __future__ import annotations

import os
import sys
from typing import NoReturn

import click

from tuning.cli import (
    arms,
    authoring,
    bench,
    comparisons,
    deployment,
    inspection,
    populations,
    recordings,
    reports,
    results,
    searches,
)
from tuning.errors import InputError

DONE, NOT_HELD, BAD_INPUT, INTERRUPTED = 0, 1, 2, 3


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="vsajax")
def cli() -> None:
    """Simulate, estimate and tune the stiffness of variable-stiffness robot joints.

    Start with:  vsajax init serial study.toml
    """


for command in (
    authoring.init,
    authoring.check,
    recordings.simulate,
    recordings.estimate,
    searches.sweep,
    populations.montecarlo,
    searches.tune,
    comparisons.compare,
    comparisons.contest,
    arms.stiffness,
    arms.workspace,
    arms.poses,
    reports.report,
    results.reproduce,
    deployment.export,
    bench.bench,
    inspection.doctor,
):
    cli.add_command(command)


def run(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code."""
    try:
        return cli.main(arguments, prog_name="vsajax", standalone_mode=False) or DONE
    except click.exceptions.Exit as ending:
        return ending.exit_code
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; finished work is kept: run the same command with --resume", err=True)
        return INTERRUPTED
    except click.ClickException as error:
        error.show(sys.stderr)
        return BAD_INPUT
    except InputError as error:
        click.echo(_as_text(error), err=True)
        return BAD_INPUT
    except Exception as error:
        message = _users_mistake(error)
        if message is None:
            raise
        click.echo(f"error: {message}", err=True)
        return BAD_INPUT


def main() -> NoReturn:
    """Enter from the shell."""
    code = run()
    if code == INTERRUPTED:
        # Threads of the compiled program may still run; tearing the interpreter down under them would crash it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _as_text(error: InputError) -> str:
    return "\n".join(f"error: {mistake}" for mistake in error.mistakes)


def _users_mistake(error: Exception) -> str | None:
    """Return what to tell the user where the library refused the user's input, else `None`."""
    if "jax" not in sys.modules:
        return None
    from vsajax import MissingSignalError

    return str(error) if isinstance(error, MissingSignalError | FloatingPointError) else None
