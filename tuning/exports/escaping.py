"""Text of the user's in comments, strings and pages of every format: none of it is read as that format's own."""

from __future__ import annotations

import re
from html import escape

from tuning.files.text import plain


def comment_of_c(text: str) -> str:
    """Return text for a comment of C: it neither ends the comment, begins another, nor continues a line."""
    return plain(text).replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /").replace("\\", "/")


def string_of_c(text: str) -> str:
    """Return text for a string literal of C that is no format: no quote ends it, nothing in it is a trigraph."""
    quoted = plain(text).replace("\\", "\\\\").replace('"', '\\"')
    return quoted.replace("??", "?\\?")


def text_of_xml(text: str) -> str:
    """Return text for an attribute or an element of XML."""
    return escape(plain(text))


def text_of_markdown(text: str) -> str:
    """Return text for a page of Markdown, also within a table: nothing in it is markup or HTML."""
    return re.sub(r"([\\`*\[\]<>#|~$&!]|(?<!\w)_|_(?!\w))", r"\\\1", plain(text))
