"""How pages are filled in: text is escaped, code in backticks set as code, a gap that nothing fills is an error."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markupsafe import Markup

if TYPE_CHECKING:
    import jinja2


def environment(*rooms: tuple[str, str]) -> jinja2.Environment:
    """Templates of HTML pages.

    Args:
        rooms: (package, folder in it) where templates are looked for, in this order.
    """
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package, folder) for package, folder in rooms]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters["coded"] = coded
    return made


def coded(text: str) -> Markup:
    """What stands between backticks as code."""
    parts = (Markup("<code>{}</code>" if k % 2 else "{}").format(part) for k, part in enumerate(text.split("`")))
    return Markup("").join(parts)
