"""Templates of the files in C, filled in."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def rendered(template: str, **parts: Any) -> str:
    """A template of this package with its gaps filled."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("etcfit.exporting", "template"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"number": repr, "comment": comment}
    return environment.get_template(template).render(**parts)


def comment(lines: Iterable[str], mark: str = " * ", width: int = 110) -> str:
    """Sentences as the inside of a comment, a line each, wrapped; no text can end a comment of C or of XML."""
    import textwrap

    safe = (line.replace("*/", "* /").replace("--", "- -") for line in lines)
    wrapped = (textwrap.fill(line, width, initial_indent=mark, subsequent_indent=mark) for line in safe)
    return "\n".join(wrapped)
