"""Parts of pages: templates, styles, scripts, data, tables, and the form of symbols, units and numbers.

Text is escaped, text in backticks becomes code, and a missing value of a template is an error.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from markupsafe import Markup, escape

from .numbers import SUPERSCRIPT, short
from .table import Cell

if TYPE_CHECKING:
    import jinja2


def environment(*rooms: Room) -> jinja2.Environment:
    """Templates of HTML pages, from these rooms, in this order, then from those that all pages share."""
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package, folder) for package, folder in (*rooms, SHARED)]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    made.filters |= {"coded": coded, "typeset": typeset, "figures": figures, "symbol": symbol}
    return made


def coded(text: str) -> Markup:
    """Text with the parts between backticks as code."""
    parts = (Markup("<code>{}</code>" if k % 2 else "{}").format(part) for k, part in enumerate(text.split("`")))
    return Markup("").join(parts)


Room = tuple[str, str]  # a package, and a folder in it
SHARED: Room = ("etcfit.reporting", "assets")
LIBRARY, LIBRARY_STYLE = "vendor/uPlot.iife.min.js", "vendor/uPlot.min.css"
LICENCE = "vendor/uPlot.LICENSE.txt"
_VENDOR: Room = ("etcfit.reporting.interactive", "page")  # the package's list of licences names this folder


@dataclass(frozen=True)
class Parts:
    """Files of a page, by name."""

    own: tuple[Room, ...]

    def __call__(self, name: str) -> str:
        """A file's text.

        Raises:
            FileNotFoundError: no room has the file.
        """
        for package, folder in (*self.own, SHARED, _VENDOR):
            file = files(package) / folder / name
            if file.is_file():
                return file.read_text(encoding="utf-8")
        raise FileNotFoundError(f"no file {name!r} in {[*self.own, SHARED]}")

    def every(self, names: Sequence[str]) -> list[str]:
        """The texts of several, in this order."""
        return [self(name) for name in names]


def scripted(
    part: Parts, carried: dict[str, Any], style: str, scripts: Sequence[str], before: Sequence[str] = (), **given: Any
) -> str:
    """A whole interactive page, from `page.html` of its own room.

    Args:
        style, scripts: names of files in addition to the common ones.
        before: scripts that are not in a file.
        given: further values of the template.
    """
    template = environment(*part.own).get_template("page.html")
    return template.render(
        text=as_text(carried),
        styles=part.every((LIBRARY_STYLE, "base.css", style)),
        scripts=[*before, *part.every((LIBRARY, *scripts))],
        licence=part(LICENCE),
        **given,
    )


def as_text(data: dict[str, Any]) -> str:
    """The object for a <script type="application/json">, without text that could end the tag."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


_UNITS = {"ohm": "Ω", "1": "", "deg": "°"}
_GREEK = {"delta": "δ", "mu": "μ", "omega": "ω", "tau": "τ", "theta": "θ"}


def symbol(name: str) -> Markup:
    """R_a as R with a subscript, theta_lh with its letter; text after a point is unchanged."""
    head, _, below = name.partition("_")
    head = _GREEK.get(head, head)
    if "." in name or len(head) > 2:
        return Markup("<code>{}</code>").format(Markup(".<wbr>").join(name.split(".")))
    if not below:
        return Markup("<i>{}</i>").format(name)
    return Markup("<i>{}</i><sub>{}</sub>").format(head, below)


def symbols(names: Iterable[str]) -> Markup:
    """a, b and c."""
    *most, last = [symbol(name) for name in names]
    return Markup(", ").join(most) + Markup(" and ") + last if most else last


def unit(text: str | None) -> str:
    """N*m*s/rad with centred dots and raised exponents."""
    if not text or text in _UNITS:
        return _UNITS.get(text or "1", "")
    text = re.sub(r"\bohm\b", "Ω", text).replace("**", "")
    text = re.sub(r"(?<=[a-zA-Z])-?\d", lambda power: power[0].translate(SUPERSCRIPT), text)
    return text.replace("*", " · ") if "*" in text else text.replace(" ", " ")


def figure(text: str) -> str:
    """1.2e-06 with a power of ten, a true minus sign."""
    mantissa, e, exponent = text.partition("e")
    power = f" × 10{str(int(exponent)).translate(SUPERSCRIPT)}" if e else ""
    return mantissa.replace("-", "−") + power if mantissa != "-" else "–"


_NUMBER = re.compile(r"(?<![\w.])-?\d+(\.\d+)?(e[+-]\d+)?(?![\w.]*\w)")


def figures(text: str) -> str:
    """A text with its numbers and signs in the form of `figure`."""
    if text == "-":
        return "–"
    for plain, typeset in ((" ... ", " … "), (" +- ", " ± "), ("<= ", "≤ "), (">= ", "≥ ")):
        text = text.replace(plain, typeset)
    return _NUMBER.sub(lambda found: figure(found[0]), text)


def typeset(cell: Cell) -> Markup | str:
    """A cell of a table."""
    if cell.kind == "symbol":
        return symbol(cell.text)
    if cell.kind in ("word", "prose", "path", "hash"):
        return coded(cell.text)
    return {"name": lambda text: text.replace("_", " "), "unit": unit}.get(cell.kind, figures)(cell.text)


def number(value: float | None, digits: int = 3) -> str:
    """A few significant digits."""
    return figure(short(value, digits))


def polynomial(coefficients: Iterable[float], variable: str = "s") -> Markup:
    """c_n s^n + ... + c_0, highest power first."""
    every = list(coefficients)
    terms: list[Markup] = []
    for k, c in enumerate(every):
        power = len(every) - 1 - k
        raised = Markup("<i>{}</i>").format(variable) + (Markup("<sup>{}</sup>").format(power) if power > 1 else "")
        size = "" if abs(c) == 1.0 and power else figure(short(abs(c), 4))
        sign = (" − " if c < 0.0 else " + ") if terms else ("−" if c < 0.0 else "")
        terms.append(Markup(sign) + escape(size) + (" " if size and power else "") + (raised if power else Markup("")))
    return Markup("").join(terms)
