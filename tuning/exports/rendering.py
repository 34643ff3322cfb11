"""Text files from the templates beside this module."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from tuning.exports.escaping import comment_of_c, text_of_markdown, text_of_xml

TEMPLATES = Path(__file__).parent / "templates"


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    environment.filters |= {"c": comment_of_c, "xml": text_of_xml, "markdown": text_of_markdown}
    return environment


def render(template: str, **values: Any) -> str:
    """Return a template with its values filled in."""
    return _environment().get_template(f"{template}.jinja").render(values)
