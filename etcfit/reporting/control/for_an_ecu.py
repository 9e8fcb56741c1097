"""What is typed or pasted into an ECU, for stdout: lines of its tune file, settings, gains over the supply."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any
from xml.etree import ElementTree as Xml

from rich.console import Group, RenderableType
from rich.text import Text

from ...control.pid import Gains, Task
from ...control.supply_table import SupplyTable
from ...model.ecus import Pasting, Scheduling, named
from ...run_folder.design import supply_table_json
from ..blocks import headed, plain_table, sentences, stacked
from ..numbers import short


def snippet(written: Mapping[str, Any]) -> RenderableType:
    """The settings of `profile` in pid.json, and what is assumed of that ECU."""
    pasting, code = named(written["name"]).pasting, written.get("code")
    lines = (line for each in constants(written) for line in Xml.tostring(each, "unicode").splitlines())
    return stacked(
        headed(f"For {written['title']}: {pasting.value}",
               _lines(lines) if pasting is Pasting.TUNE_FILE else _by_hand(written)),
        sentences("What these gains mean", written.get("says") or []),
        headed(CODE, _lines(code)) if code else None,
        sentences("Assumed of it", [f"assumed: {each}" for each in written["assumed"]]),
    )  # fmt: skip


CODE = "Behind its PID, in your own code, at each tick, in %; rate begins at 0 and before at the target"


def _lines(lines: Iterable[str]) -> RenderableType:
    return Group(*(Text(line, no_wrap=True, overflow="ignore") for line in lines))


def constants(written: Mapping[str, Any]) -> Iterator[Xml.Element]:
    """A `<constant>` a setting, as TunerStudio writes them into a .msq.

    Source: .msq files of rusEFI; `digits` is what TunerStudio shows of a value.
    """
    for name, gain in written["gains"].items():
        yield _constant({"digits": "4", "name": name}, f"{gain['value']:.8g}")
    for name, limit in written["limits"].items():
        yield _constant({"digits": "0", "name": name}, f"{limit['value']:.1f}")
    for name, row in (written["bias"] or {}).items():
        values = "".join(f"\n  {float(value)}" for value in row)
        yield _constant({"cols": "1", "digits": "2", "name": name, "rows": str(len(row))}, f"{values}\n")


def _constant(attributes: dict[str, str], text: str) -> Xml.Element:
    made = Xml.Element("constant", attributes)
    made.text = text
    return made


def _by_hand(written: Mapping[str, Any]) -> RenderableType:
    table = plain_table("setting", "value", "unit")
    table.columns[1].prose = True  # a row of eight values is broken between two of them, never cut
    for name, setting in (written["gains"] | written["limits"]).items():
        table.add_row(name, short(setting["value"], 5), setting["unit"])
    for name, row in (written["bias"] or {}).items():
        table.add_row(name, " ".join(short(value, 4) for value in row), "%")
    return table


_NOWHERE = (Scheduling.NONE, Scheduling.UNKNOWN)


def supply_table(task: Task, gains: Gains, table: SupplyTable) -> RenderableType:
    """The table where there is somewhere to type it in, and what is said of tables; see `supply_table_json`."""
    written, profile = supply_table_json(task, gains, table), task.profile
    words = sentences("Tables of gains", written["says"])
    assert words is not None, "there is always something to say"
    if profile is not None and profile.scheduling in _NOWHERE:
        return words
    shown = plain_table("gain", *(f"{supply:g} V" for supply in written["supply_V"]))
    for name, row in written["gains"].items():
        shown.add_row(name, *(short(gain, 4) for gain in row))
    unit = f"{written['unit']}, {written['form']}"
    return Group(headed(f"Gains over the supply that keep the loop what it is, in {unit}", shown), words)
