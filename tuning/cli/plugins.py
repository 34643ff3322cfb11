"""What is not vsajax' own on the command line: the consent to it, and names that it adds to vsajax' own."""

from __future__ import annotations

from collections.abc import Sequence
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
        own: vsajax' own names, told here so that nothing is imported for them.
        registry: returns where the others are.
    """

    def __init__(self, own: Sequence[str], registry: Any):
        super().__init__(own)
        self._registry = registry

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return a name that stands for something."""
        if value in self.choices:
            return value
        from tuning.study.plugins import Refused, Unknown

        registry: Registry[Any] = self._registry()
        try:
            registry.find(value)
        except Unknown:
            return super().convert(value, param, ctx)
        except Refused as refused:
            self.fail(f"{refused.problem}\n    fix: {refused.fix}", param, ctx)
        return value
