"""Files of `etcfit drive --out RUN`: drive.json, drive.html (one file without scripts) and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...car_log import DriveLog, Study, record_next
from ...car_log.coverage import Lack
from ...car_log.others import SECOND, VOLTS_1, VOLTS_2
from ...car_log.study import verdict
from ...car_log.usage import SHARE
from ...files import held, write_json, write_text
from ...rig.base import RigConfig
from ...run_folder.drive import DRIVE
from .. import style
from ..html import environment
from ..numbers import short
from ..page.pictures import carried
from . import Held, in_a_word, says_of, tables_of

_SHOWN = 8.0  # s of the log in the picture: those in which the setpoint, or else the position, moves most
_AFTER = 0.6  # s of each step response in the picture
_LEAST = 2.0  # per cent of travel: smaller steps are dominated by noise


def draw(each: Study, synthetic: bool) -> Figure:
    """Fig. 6 (a) and (b) of the paper, and below them the seconds in which the setpoint moves most."""
    fig = style.figure(11.0, 7.2, synthetic)
    grid = fig.add_gridspec(2, 2, left=0.07, right=0.98, top=0.9, bottom=0.08, hspace=0.5, wspace=0.22)
    left, right, panel = (fig.add_subplot(place) for place in (grid[0, 0], grid[0, 1], grid[1, :]))
    _histogram(left, each)
    _tones(right, each)
    _stretch(panel, each.log)
    said, follows = "no setpoint logged", each.tracking
    if follows is not None:
        lag = "" if follows.lag is None else f", {1e3 * follows.lag:.0f} ms behind"
        said = f"RMSE {follows.rmse:.2f} % of travel{lag}"
    style.title(fig, f"{each.log.name}  ·  {said}")
    return fig


def _histogram(panel: Axes, each: Study) -> None:
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
    tones = each.spectrum
    panel.set(xlabel="frequency [Hz]", ylabel="position [% rms a bin]")
    if tones is None:
        panel.set_title("too short for a spectrum", loc="left", fontsize=10)
        return
    panel.plot(tones.frequency, tones.amplitude, color=style.READING)
    panel.set_xscale("log")
    style.log_ticks(panel.xaxis, panel.get_xlim())
    panel.axvline(tones.dominant, color=style.SIMULATED, lw=1.2, ls="--")
    says = f"moved mostly at {short(tones.dominant)} Hz,\nhalf of its power below {tones.half:.2f} Hz"
    panel.set_title(says, loc="left", fontsize=10)


def _stretch(panel: Axes, log: DriveLog) -> None:
    begin = (log.setpoint or log.position).busiest(_SHOWN)
    for series, colour, name, width in ((log.setpoint, style.MEASURED, "setpoint", 1.4),
                                        (log.position, style.SIMULATED, "position", 1.6)):  # fmt: skip
        if series is not None:
            seen = (series.time >= begin) & (series.time <= begin + _SHOWN)
            panel.plot(series.time[seen], series.value[seen], color=colour, lw=width, label=name)
    panel.set(xlabel="time [s]", ylabel="throttle [% of travel]", xlim=(begin, begin + _SHOWN))
    panel.set_title(f"the {_SHOWN:g} s with the fastest setpoint", loc="left", fontsize=10)
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)


def draw_answers(each: Study, synthetic: bool) -> Figure | None:
    """Every step response over its step, the error by parts of the travel, one sensor over the other; None if the
    log has none of them."""
    shown = [panel for panel, there in ((_answers, any(abs(s.size) >= _LEAST for s in each.steps)),
                                        (_by_range, each.tracking is not None and each.tracking.ranges),
                                        (_sensors, each.sensors is not None)) if there]  # fmt: skip
    if not shown:
        return None
    fig = style.figure(3.9 * max(len(shown), 2), 3.9, synthetic)
    grid = fig.add_gridspec(1, len(shown), left=0.08, right=0.98, top=0.8, bottom=0.15, wspace=0.3)
    for k, panel in enumerate(shown):
        panel(fig.add_subplot(grid[0, k]), each)
    word = {"good": "good enough", "not good": "not good enough"}.get(
        each.verdict.word, "not enough in the log to judge"
    )
    style.title(fig, f"{each.log.name}  ·  {word}")
    return fig


def _answers(panel: Axes, each: Study) -> None:
    position = each.log.position
    large = [step for step in each.steps if abs(step.size) >= _LEAST]
    for step in large:
        seen = (position.time >= step.begin - 0.05) & (position.time <= step.begin + min(step.held, _AFTER))
        share = (position.value[seen] - step.before) / step.size
        panel.plot(position.time[seen] - step.begin, 100.0 * share, color=style.SIMULATED, lw=0.9,
                   alpha=max(0.15, min(1.0, 8.0 / len(large))))  # fmt: skip
    panel.step([-0.05, 0.0, _AFTER], [0.0, 100.0, 100.0], where="post", color=style.MEASURED, lw=1.2)
    low, high = panel.get_ylim()
    panel.set(xlabel="time after the step [s]", ylabel="way of the step [%]", xlim=(-0.05, _AFTER),
              ylim=(max(low, -60.0), min(high, 200.0)))  # fmt: skip
    panel.set_title(f"answers to {len(large)} steps", loc="left", fontsize=10)


def _by_range(panel: Axes, each: Study) -> None:
    assert each.tracking is not None
    ranges = each.tracking.ranges
    low, width = [r.low for r in ranges], [r.high - r.low for r in ranges]
    panel.bar(low, [r.rmse for r in ranges], width, align="edge", color=style.READING, edgecolor="white", lw=0.8)
    panel.plot(
        [0.5 * (r.low + r.high) for r in ranges], [r.mean for r in ranges], "o", color=style.SIMULATED, label="mean"
    )
    panel.axhline(0.0, color=style.MEASURED, lw=0.8)
    panel.set(xlabel="setpoint [% of travel]", ylabel="error [% of travel]", xlim=(0.0, 100.0))
    panel.set_title("error by parts of the travel:\nrms (bars), mean (dots)", loc="left", fontsize=10)
    panel.grid(visible=False, axis="x")


def _sensors(panel: Axes, each: Study) -> None:
    pair, along = each.sensors, each.log.others
    assert pair is not None
    first = along[VOLTS_1] if pair.unit == "V" else each.log.position
    second = along[VOLTS_2] if pair.unit == "V" else along[SECOND]
    panel.plot(
        first.value, np.interp(first.time, second.time, second.value), ".", ms=2.0, color=style.SIMULATED, alpha=0.5
    )
    panel.set(xlabel=f"first sensor [{pair.unit}]", ylabel=f"second sensor [{pair.unit}]")
    panel.set_title(f"both sensors: up to {pair.apart:.2g} % apart", loc="left", fontsize=10)


def write_page(
    path: Path, config: RigConfig, studies: Sequence[Study], lacks: Sequence[Lack], drawn: Sequence[Sequence[Path]]
) -> None:
    """Write drive.html: one section per log with its pictures, and what to record next."""
    made = environment(("etcfit.reporting.car_log", "template"))
    logs = [
        {
            "name": each.log.name,
            "seconds": float(np.ptp(each.log.position.time)),
            "word": in_a_word(each.verdict),
            "bad": each.verdict.word == "not good",
            "says": each.verdict.says,
            "columns": each.log.columns,
            "hint": each.log.hint,
            "findings": says_of(each),
            "tables": tables_of(each),
            "pictures": [carried(picture, "drive") for picture in pictures],
        }
        for each, pictures in zip(studies, drawn, strict=True)
    ]
    text = made.get_template("log.html").render(
        rig=config.name, synthetic=config.synthetic, logs=logs,
        changed=verdict(*studies) if len(studies) == 2 else "",
        to_record=[f"{lack.record}. It determines {lack.why}." for lack in lacks],
    )  # fmt: skip
    write_text(path, text)


def write_drive(
    run: Path, config: RigConfig, studies: Sequence[Study], report: Callable[[str, float], None],
    beside: Held | None = None,
) -> None:  # fmt: skip
    """Write RUN/drive.json, RUN/drive.html and RUN/pictures/drive; with `beside`, also the log and its prediction."""
    lacks = record_next([each.log for each in studies])
    found = {"config": config, "logs": studies, "record_next": lacks, "foretold": beside}
    with held(run), style.drawing():
        write_json(run / "drive.json", "drive", DRIVE.written(found))
        drawn: list[list[Path]] = []
        for k, each in enumerate(studies):
            report(f"drawing {each.log.name}", k / len(studies))
            drawn.append([])
            for suffix, drawing in (("_answers", draw_answers), ("", draw)):
                if (figure := drawing(each, config.synthetic)) is not None:
                    drawn[-1].append(run / "pictures" / "drive" / f"{Path(each.log.name).stem}{suffix}.png")
                    style.save(figure, drawn[-1][-1])
        write_page(run / "drive.html", config, studies, lacks, drawn)
