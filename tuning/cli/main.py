"""The command group, and how each kind of ending becomes an exit code."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from typing import NoReturn

import click

from tuning.cli.bench import bench
from tuning.cli.compare import compare, contest
from tuning.cli.doctor import doctor
from tuning.cli.export import export
from tuning.cli.init import check, init
from tuning.cli.montecarlo import montecarlo
from tuning.cli.parts import parts
from tuning.cli.plugins import with_plugins
from tuning.cli.report import report
from tuning.cli.reproduce import reproduce
from tuning.cli.schema import schema
from tuning.cli.simulate import estimate, simulate
from tuning.cli.tune import sweep, tune
from tuning.files.errors import InputError, input_error
from tuning.kinds.arm.commands import poses, stiffness, workspace

DONE, NOT_HELD, BAD_INPUT, INTERRUPTED = 0, 1, 2, 3


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="vsajax")
def cli() -> None:
    """Simulate, estimate and tune the stiffness of variable-stiffness robot joints.

    Start with:  vsajax init serial study.toml
    """


for command in (
    init,
    with_plugins(check),
    parts,
    schema,
    *map(with_plugins, (simulate, estimate, sweep, montecarlo, tune, compare, contest)),
    *map(with_plugins, (stiffness, workspace, poses, report, reproduce, export)),
    bench,
    doctor,
):
    cli.add_command(command)


def run(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code."""
    try:
        given = sys.argv[1:] if arguments is None else arguments
        _check_encoding(given)
        return cli.main(given, prog_name="vsajax", standalone_mode=False, obj=tuple(given)) or DONE
    except click.exceptions.Exit as ending:
        return ending.exit_code
    except (KeyboardInterrupt, click.Abort):
        with _unheard():
            click.echo("interrupted; finished work is kept: run the same command with --resume", err=True)
        return INTERRUPTED
    except click.ClickException as error:
        with _unheard():
            error.show(sys.stderr)
        return BAD_INPUT
    except Exception as error:
        message = _as_text(error) if isinstance(error, InputError) else _users_mistake(error)
        if message is None:
            raise
        with _unheard():
            click.echo(message, err=True)
        return BAD_INPUT


def _check_encoding(arguments: list[str]) -> None:
    """Refuse words that are no text: the names of files stand in messages, manifests and what is exported."""
    for word in arguments:
        if not word.isascii() and any("\ud800" <= letter <= "\udfff" for letter in word):
            shown = word.encode("utf-8", "backslashreplace").decode()
            raise input_error(shown, "is not UTF-8 text", "rename the file, or name it by a link in UTF-8")


def main() -> NoReturn:
    """Enter from the shell."""
    code = run()
    if code == INTERRUPTED:
        # Threads of the compiled program may still run; tearing the interpreter down under them would crash it.
        with _unheard():
            _flush()
            sys.stderr.flush()
        os._exit(code)
    try:
        _flush()
    except OSError:
        # It was told already. What is left unwritten must not be tried again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _flush() -> None:
    # Python has no standard output where the shell closed it.
    if sys.stdout is not None:
        sys.stdout.flush()


@contextlib.contextmanager
def _unheard() -> Iterator[None]:
    """Go on where nobody can be told: standard error is closed, or on a full disk."""
    with contextlib.suppress(OSError):
        yield


def _as_text(error: InputError) -> str:
    return "\n".join(f"error: {mistake}" for mistake in error.mistakes)


def _users_mistake(error: Exception) -> str | None:
    """Return what to tell of what a user can mend though no reader of input found it, else `None`."""
    if isinstance(error, OSError):
        if error.filename is not None:
            return f"error: {error.filename}: cannot be read or written ({error.strerror})"
        # Files are told by name; without one it is where the answer was printed to.
        if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}:
            problem = f"error: standard output: cannot be written ({error.strerror})"
            return f"{problem}\n    fix: make room there, or send it elsewhere; what was written to files is whole"
        return None
    if "jax" not in sys.modules:
        return None
    from vsajax import MissingSignalError

    return f"error: {error}" if isinstance(error, MissingSignalError | FloatingPointError) else None
