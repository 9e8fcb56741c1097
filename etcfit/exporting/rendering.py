"""Templates of the files in C, Python and HTML, filled in."""

from __future__ import annotations

from typing import Any

from ..rig.user_text import c_comment, in_c, one_line


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
    environment.filters |= {"number": repr, "c_comment": c_comment, "in_c": in_c, "one_line": one_line}
    return environment.get_template(template).render(**parts)
