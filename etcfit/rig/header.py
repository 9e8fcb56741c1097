"""A column header `quantity [unit]`, read and checked against what is known."""

from __future__ import annotations

import difflib
import re

from .comments import toml_string
from .units import EXAMPLES, SI_UNIT, UnitError, conversion, is_percent

DROP = ("", "ignore")  # right-hand sides in [columns] that leave a column out
_FORM = re.compile(r"(?P<quantity>[^\[\]]+?)\s*\[\s*(?P<unit>[^\[\]]*?)\s*\]")


class HeaderError(ValueError):
    """A header that names no quantity or no unit; the three texts of a MeasurementError without its place."""

    def __init__(self, found: str, required: str, mend: str) -> None:
        self.found, self.required, self.mend = found, required, mend
        super().__init__(f"{found} {required} {mend}")


def parse_header(header: str) -> tuple[str, str]:
    """Quantity and unit of `quantity [unit]`; letter case and spaces in the quantity do not matter.

    Raises:
        HeaderError: unknown quantity, unit missing, or a unit of the wrong dimension.
    """
    match = _FORM.fullmatch(header.strip())
    quantity = _slug(match["quantity"] if match else header)
    if quantity not in SI_UNIT:
        raise _foreign(header, quantity)
    if match is None or not match["unit"]:
        raise HeaderError(f"column '{header}' has no unit.", f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                          f"Write the unit in brackets, as in '{quantity} [{_example(quantity)}]'.")  # fmt: skip
    if not (quantity in ("position", "setpoint") and is_percent(match["unit"])):
        _check_unit(header, quantity, match["unit"])
    return quantity, match["unit"]


def _check_unit(header: str, quantity: str, unit: str) -> None:
    try:
        conversion(quantity, unit)
    except UnitError as err:
        raise HeaderError(f"column '{header}': {err}", f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                          f"Correct the unit, as in '{quantity} [{_example(quantity)}]'.") from err  # fmt: skip


def _foreign(header: str, quantity: str) -> HeaderError:
    match = difflib.get_close_matches(quantity, SI_UNIT, n=1, cutoff=0.75)
    guess = f" Did you mean '{match[0]} [{_example(match[0])}]'?" if match else ""
    return HeaderError(f"column '{header}' is not known.", f"Known: {', '.join(SI_UNIT)}.",
                       f"Add it to rig.toml under [columns], as {toml_string(header)} = \"position [deg]\" "
                       f"(or = \"ignore\"), or delete the column.{guess}")  # fmt: skip


def _slug(text: str) -> str:
    return "_".join(text.casefold().split())


def _example(quantity: str) -> str:
    return EXAMPLES[quantity].split(" or ")[0].split(",")[0]
