"""What `etcfit drive` prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ...car_log import DriveLog, Study, record_next
from ...car_log.study import verdict
from ...car_log.usage import SHARE
from ...rig.base import RigConfig
from ..blocks import headed, plain_table, rig_title, sentences, spaced
from ..numbers import short
from ..page.table import Table
from .tables import in_a_word, judgements_table, says_of, tables_of

# without lag: RMSE against the setpoint delayed by the lag
_HEADS = ("length", "between %", "share of time %", f"{100 * SHARE:.0f} % of time within %", "dominant Hz",
          "half of power below Hz", "RMSE %", "RMSE +- %", "lag ms", "lag +- ms", "RMSE without lag %",
          "setpoint moves %/s")  # fmt: skip
_SPARE = ("setpoint moves %/s", "half of power below Hz", "RMSE without lag %", "between %", "dominant Hz", "length")
_FILE = "drive.json of --out RUN"
_PROSE = ("where", "threshold from")
_MAY_GO = ("threshold from", "where", "rms %", "half way ms")


def drive_table(config: RigConfig, studies: Sequence[Study]) -> RenderableType:
    """A row a log, then each log held against the thresholds; of two logs also what changed."""
    table = plain_table("log", *_HEADS, paths=("log",), spare=_SPARE, file=_FILE)
    for each in studies:
        table.add_row(each.log.name, f"{np.ptp(each.log.position.time):.0f} s", *_cells(each))
    logs = [each.log for each in studies]
    parts = [
        rig_title(config, "logs from the car"),
        headed("In per cent of the travel; +-: one standard error", table),
        sentences("Columns that were taken", [_columns(log) for log in logs if log.columns]),
        sentences("What to look at", [f"{log.name}: {log.hint}" for log in logs if log.hint]),
        *(part for each in studies for part in _answer(each)),
        spaced(Text(f"{logs[0].name} -> {logs[1].name}: {verdict(*studies)}")) if len(studies) == 2 else None,
        _next(logs),
    ]
    return Group(*(part for part in parts if part is not None))


def shown(table: Table) -> RenderableType:
    """A table of the page in a terminal."""
    made = plain_table(*table.head, left=max(table.words, 1), prose=[name for name in _PROSE if name in table.head],
                       spare=[name for name in _MAY_GO if name in table.head], file=_FILE)  # fmt: skip
    for k, row in enumerate(table.rows):
        made.add_row(*(Text(cell, style="bold red" if k in table.marked else "") for cell in row))
    return made


def good_enough(each: Study) -> RenderableType:
    """One log held against the thresholds, with what was found at rest and of its sensors."""
    said = (Padding(Text(f"- {text}"), (0, 0, 0, 2)) for text in says_of(each))
    return Group(shown(judgements_table(each.verdict.judgements)), *said)


def _answer(each: Study) -> Iterator[RenderableType]:
    yield spaced(Text(f"{each.log.name}: {in_a_word(each.verdict)}", style="bold"))
    yield from (Padding(Text(f"- {text}"), (0, 0, 0, 2)) for text in says_of(each))
    for table in tables_of(each):
        yield headed(f"{each.log.name}: {table.caption}", shown(table))


def _next(logs: Sequence[DriveLog]) -> RenderableType | None:
    """What to record next, for gains to be told from these logs."""
    said = [f"{lack.name} ({lack.found:.3g} of {lack.needed:g} {lack.unit}): {lack.record}. It tells "
            f"{lack.why}" for lack in record_next(logs)]  # fmt: skip
    return sentences("To record next, on the bench as closed_loop/ or from the car", said)


def _columns(log: DriveLog) -> str:
    """As the file names them: a pedal that passes for the plate shows here."""
    return f"{log.name}: " + ", ".join(f"{quantity} '{header}'" for quantity, header in log.columns.items())


def _cells(each: Study) -> tuple[str, ...]:
    use, tones, follows = each.usage, each.spectrum, each.tracking
    where = (
        f"{use.bounds[0]:g}..{use.bounds[1]:g}",
        f"{100.0 * use.between:.1f}",
        "{:.1f} .. {:.1f}".format(*use.shortest),
    )
    speed = ("-", "-") if tones is None else (short(tones.dominant), f"{tones.half:.2f}")
    if follows is None:
        return (*where, *speed, "-", "-", "-", "-", "-", "-")
    lag = None if follows.lag is None else 1e3 * follows.lag
    off = f"{follows.rmse:.2f}", _spread(follows.stderr, 0.01)
    late = ("-", "-") if lag is None else (f"{lag:.0f}", _spread(follows.lag_stderr, 0.1, 1e3))
    return (*where, *speed, *off, *late, short(follows.left), short(follows.demand))


def _spread(stderr: float | None, least: float, scale: float = 1.0) -> str:
    """A standard error, no finer than the figure that it belongs to."""
    if stderr is None:
        return "-"
    return short(scale * stderr, 2) if scale * stderr >= 0.5 * least else f"<{least:g}"
