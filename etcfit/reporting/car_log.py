"""What `etcfit drive` shows of logs from the car: a table, and a picture a log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..car_log import DriveLog, Study, record_next
from ..car_log.study import verdict
from ..car_log.usage import SHARE
from ..files import held, plain, write_json
from ..rig.base import RigConfig
from .blocks import headed, plain_table, rig_title, sentences, spaced
from .numbers import short

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN = 8.0  # s of the log, where most is asked of the plate


def drive_table(config: RigConfig, studies: Sequence[Study]) -> RenderableType:
    """A row a log for stdout; where there are two, what changed from the first to the second."""
    table = plain_table("log", *_HEADS, paths=("log",), spare=_SPARE, file="drive.json of --out RUN")
    for each in studies:
        table.add_row(each.log.name, f"{np.ptp(each.log.position.time):.0f} s", *_cells(each))
    logs = [each.log for each in studies]
    parts = [
        rig_title(config, "logs from the car"),
        headed("In per cent of the travel; +-: one standard error", table),
        sentences("Columns that were taken", [_columns(log) for log in logs if log.columns]),
        sentences("What to look at", [f"{log.name}: {log.hint}" for log in logs if log.hint]),
        spaced(Text(f"{logs[0].name} -> {logs[1].name}: {verdict(*studies)}")) if len(studies) == 2 else None,
        _next(logs),
    ]
    return Group(*(part for part in parts if part is not None))


def _next(logs: Sequence[DriveLog]) -> RenderableType | None:
    """What to record next, for gains to be told from these logs."""
    said = [f"{lack.name} ({lack.found:.3g} of {lack.needed:g} {lack.unit}): {lack.record}. It tells "
            f"{lack.why}" for lack in record_next(logs)]  # fmt: skip
    return sentences("To record next, on the bench as closed_loop/ or from the car", said)


# without lag: RMSE against the setpoint delayed by the lag
_HEADS = ("length", "between %", "share of time %", f"{100 * SHARE:.0f} % of time within %", "dominant Hz",
          "half of power below Hz", "RMSE %", "RMSE +- %", "lag ms", "lag +- ms", "RMSE without lag %",
          "setpoint moves %/s")  # fmt: skip
_SPARE = ("setpoint moves %/s", "half of power below Hz", "RMSE without lag %", "between %", "dominant Hz", "length")


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
    speed = ("-", "-") if tones is None else (_hertz(tones.dominant), f"{tones.half:.2f}")
    if follows is None:
        return (*where, *speed, "-", "-", "-", "-", "-", "-")
    lag = None if follows.lag is None else 1e3 * follows.lag
    off = f"{follows.rmse:.2f}", _spread(follows.stderr, 0.01)
    late = ("-", "-") if lag is None else (f"{lag:.0f}", _spread(follows.lag_stderr, 0.1, 1e3))
    return (*where, *speed, *off, *late, short(follows.left), short(follows.demand))


def _hertz(frequency: float) -> str:
    return f"{frequency:.2f}" if np.isfinite(frequency) else "-"


def _spread(stderr: float | None, least: float, scale: float = 1.0) -> str:
    """A standard error, no finer than the figure that it belongs to."""
    if stderr is None:
        return "-"
    return short(scale * stderr, 2) if scale * stderr >= 0.5 * least else f"<{least:g}"


def write_drive(run: Path, config: RigConfig, studies: Sequence[Study], report: Callable[[str, float], None]) -> None:
    """RUN/drive.json and RUN/pictures/drive: what the table says in full, and a picture a log."""
    content = {"rig": config.name, "synthetic": config.synthetic, "logs": [_json(each) for each in studies],
               "record_next": plain(record_next([each.log for each in studies]))}  # fmt: skip
    from . import style

    with held(run), style.drawing():
        write_json(run / "drive.json", "drive", content)
        for k, each in enumerate(studies):
            report(f"drawing {each.log.name}", k / len(studies))
            style.save(draw(each, config.synthetic), run / "pictures" / "drive" / f"{Path(each.log.name).stem}.png")


def _json(each: Study) -> dict[str, Any]:
    keys = ("usage", "spectrum", "tracking")
    return plain(
        {"file": each.log.name, "seconds": np.ptp(each.log.position.time), "columns": each.log.columns}
        | {k: getattr(each, k) for k in keys}
    )


def draw(each: Study, synthetic: bool) -> Figure:
    """Fig. 6 (a) and (b) of the paper, and below them the seconds in which most is asked of the plate."""
    from . import style

    fig = style.figure(11.0, 7.2, synthetic)
    grid = fig.add_gridspec(2, 2, left=0.07, right=0.98, top=0.9, bottom=0.08, hspace=0.5, wspace=0.22)
    left, right, panel = (fig.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
    _histogram(left, each)
    _tones(right, each)
    _stretch(panel, each.log)
    fig.suptitle(f"{each.log.name}  ·  {_says(each)}", x=0.015, y=0.985, ha="left", va="top", fontsize=13)
    return fig


def _says(each: Study) -> str:
    follows = each.tracking
    if follows is None:
        return "no setpoint logged"
    lag = "" if follows.lag is None else f", {1e3 * follows.lag:.0f} ms behind"
    return f"RMSE {follows.rmse:.2f} % of travel{lag}"


def _histogram(panel: Axes, each: Study) -> None:
    from . import style

    use = each.usage
    low, high = use.shortest
    panel.axvspan(low, high, color=style.BAND, lw=0)
    panel.bar(use.edges[:-1], 100.0 * use.shares, np.diff(use.edges), align="edge", color=style.READING,
              edgecolor="white", lw=0.8)  # fmt: skip
    panel.set(xlabel="throttle position [% of travel]", ylabel="share of the time [%]")
    panel.set_title(f"{100 * SHARE:.0f} % of the time within {low:.0f} … {high:.0f} % (grey);\n"
                    f"{100.0 * use.between:.0f} % of it between {use.bounds[0]:g} and {use.bounds[1]:g} %",
                    loc="left", fontsize=10)  # fmt: skip
    panel.grid(visible=False, axis="x")


def _tones(panel: Axes, each: Study) -> None:
    from . import style

    tones = each.spectrum
    panel.set(xlabel="frequency [Hz]", ylabel="position [% rms a bin]")
    if tones is None:
        panel.set_title("too short for a spectrum", loc="left", fontsize=10)
        return
    panel.plot(tones.frequency, tones.amplitude, color=style.READING)
    panel.set_xscale("log")
    style.log_ticks(panel.xaxis, panel.get_xlim())
    panel.axvline(tones.dominant, color=style.SIMULATED, lw=1.2, ls="--")
    says = f"moved mostly at {_hertz(tones.dominant)} Hz,\nhalf of its power below {tones.half:.2f} Hz"
    panel.set_title(says, loc="left", fontsize=10)


def _stretch(panel: Axes, log: DriveLog) -> None:
    from . import style

    begin = (log.setpoint or log.position).busiest(_SHOWN)
    for series, colour, name, width in ((log.setpoint, style.MEASURED, "setpoint", 1.4),
                                        (log.position, style.SIMULATED, "position", 1.6)):  # fmt: skip
        if series is not None:
            seen = (series.time >= begin) & (series.time <= begin + _SHOWN)
            panel.plot(series.time[seen], series.value[seen], color=colour, lw=width, label=name)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]", xlim=(begin, begin + _SHOWN))
    panel.set_title(f"the {_SHOWN:g} s in which most is asked of it", loc="left", fontsize=10)
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
