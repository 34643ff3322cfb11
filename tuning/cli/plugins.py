"""What is not vsajax' own on the command line: the consent to it, and names that it adds to vsajax' own."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import click

from tuning.terminal.following import CONSENTED

if TYPE_CHECKING:
    from tuning.study.registry import Registry


def _consent(context: click.Context, _: click.Parameter, modules: tuple[str, ...]) -> None:
    if not modules or context.resilient_parsing:
        return
    from tuning.study.plugins import consenting, require_module

    for module in modules:
        require_module(module, "--plugin")
    # Until the command has ended: the next one of this process must be told anew.
    context.with_resource(consenting(*modules))
    context.meta[CONSENTED] = modules


def with_plugins(command: click.Command) -> click.Command:
    """Add the option by which the user consents to importing a module that a file names."""
    command.params.append(
        click.Option(
            ["--plugin"],
            multiple=True,
            metavar="MODULE",
            expose_value=False,
            is_eager=True,
            callback=_consent,
            help="Let files name parts of this module, MODULE:Name or MODULE.x:Name; repeatable.",
        )
    )
    return command


class OpenChoice(click.Choice[str]):
    """One of vsajax' own names, or one that a package or a module adds, which is looked for when it is asked for.

    Args:
        registry: returns where they are; imported when the first of them is asked for.
        more: further names.
    """

    case_sensitive = True

    def __init__(self, registry: Callable[[], Registry[Any]], *more: str):
        # Not that of `Choice`, which asks for the names while commands are being made.
        self._registry, self._more = registry, more

    @cached_property
    def choices(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The names that need no consent and no search."""
        return (*self._registry().own(), *self._more)

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return a name that stands for something."""
        if value in self.choices:
            return value
        from tuning.study.plugins import Refused, Unknown

        try:
            self._registry().find(value)
        except Unknown:
            return super().convert(value, param, ctx)
        except Refused as refused:
            self.fail(f"{refused.problem}\n    fix: {refused.fix}", param, ctx)
        return value
