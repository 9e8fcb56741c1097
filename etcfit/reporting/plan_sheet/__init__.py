"""A plan on the terminal, and PLAN/procedure.html: its sheet for the bench, on paper."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import RenderableType

from ...experiment.campaign import Campaign, PlannedTest, band, logger
from ...experiment.plan import channels
from ...files import write_text
from ...rig import TEST_BY_NAME
from ...rig.base import Channel
from .. import style
from ..blocks import rig_title, stacked
from ..check_table import with_remark
from ..drawing import draw_one
from ..html import environment
from ..numbers import short
from ..page.pictures import Picture, carried
from ..table import Column, Notes, Table, of_texts
from ..traces import headed as panels_headed
from ..traces import stack


def plan_table(campaign: Campaign) -> RenderableType:
    """A campaign for stdout."""
    why = list(dict.fromkeys(why for _, why in campaign.left_out))
    return stacked(
        rig_title(campaign.rig.config, f"the next {len(campaign.tests)} tests, {campaign.seconds:.0f} s of log"),
        tests_table(campaign),
        _stderr(campaign.symbols, campaign.now, campaign.expected, _EXPECTED),
        Notes("Cautions", campaign.cautions),
        Notes(f"Left out: {len(campaign.left_out)} candidates would exceed a limit, for example", why[:3]),
    )


def tests_table(campaign: Campaign) -> Table:
    """The tests in the order in which they are made."""
    warm = campaign.settings.ambient
    rows = [{"file": t.file, "test": t.candidate.plan.test, "how": t.candidate.plan.says,
             "seconds": t.candidate.seconds, "current": t.forecast.amps, "temperature": t.forecast.hottest(warm),
             "pause": t.pause, "remark": campaign.remark(t)} for t in campaign.tests]  # fmt: skip
    return Table("In this order", (
        Column("record as", "file", "path"), Column("what", with_remark, "prose"),
        Column("current, A", lambda row: f"{row['current']:.1f}"),
        Column("winding, degC", lambda row: f"{row['temperature']:.0f}"),
        Column("pause, s", lambda row: f"{row['pause']:.0f}")), rows)  # fmt: skip


_BAND = "#f2c49b"
_LIMIT = "#a83a00"
# units for people, if the rig has not logged the channel
_UNITS = {"current": ("A", 1.0), "position": ("deg", float(np.pi / 180.0)), "emf": ("V", 1.0),
          "motor_speed": ("rpm", float(np.pi / 30.0))}  # fmt: skip


def panels_of(test: PlannedTest, campaign: Campaign) -> tuple[str, ...]:
    """Channels with a panel: logged channels, and always current and angle."""
    boundary = TEST_BY_NAME[test.candidate.plan.test].boundary
    still = {"position"} if boundary.plate_held or boundary.gear_apart else set()
    idle = {"current"} if boundary.terminals_open else set()
    wanted = {*channels(test.candidate.plan, campaign.setting), "current", "position"} - still - idle
    return tuple(name for name in test.forecast.shown if name in wanted)


def draw(test: PlannedTest, campaign: Campaign, number: int) -> Figure:
    """Panels one above the other on one time axis."""
    names, plan = panels_of(test, campaign), test.candidate.plan
    heights = [1.1] * (plan.volts is not None) + [1.8] * len(names) + [1.0] * ("current" in names)
    fig, panels = stack(heights, campaign.rig.config.synthetic)
    rest = list(panels)
    if test.candidate.played is not None:
        panel = rest.pop(0)
        played = test.candidate.played
        panel.step(played.time, played.volts, where="post", color=style.DRIVE, lw=1.2, label="played")
        panel.set_ylabel("voltage [V]")
    for name in names:
        _channel(rest.pop(0), test, campaign, name)
    if "current" in names:
        panel, warm = rest.pop(0), campaign.settings.ambient + test.forecast.warmth
        _banded(panel, test.forecast.time, warm[0], np.stack([warm.min(axis=0), warm.max(axis=0)]))
        panel.set_ylabel("winding [°C]")
    panels[-1].set_xlim(0.0, float(plan.time[-1]))
    return panels_headed(fig, panels, f"Test {number}: {test.file}", "")


def _channel(panel: Axes, test: PlannedTest, campaign: Campaign, name: str) -> None:
    own = next((m.channels[name] for m in campaign.rig.measurements if name in m.channels), None)
    unit, value = _as_read(name, test.forecast.shown[name][0], own)
    ends = np.stack([_as_read(name, end, own)[1] for end in band(test, campaign.setting, name)])
    _banded(panel, test.forecast.time, value, ends)
    panel.set_ylabel(style.unit_label(name, unit))
    if name == "current" and np.abs(ends).max() > 0.7 * campaign.settings.current:
        panel.axhline(campaign.settings.current, color=_LIMIT, lw=1.0, ls="--", label="limit")
    if name == "position" and unit == "deg":
        for stop in (campaign.setting.rest, campaign.setting.open):
            panel.axhline(float(np.degrees(stop)), color=_LIMIT, lw=1.0, ls="--", label="rest, open stop")


def _as_read(name: str, values: np.ndarray, own: Channel | None) -> tuple[str, np.ndarray]:
    """Unit and values for people: the unit of the rig's logs, an angle in degrees."""
    if own is not None and name not in ("position", "current"):
        return own.unit, own.logged(values)
    unit, size = _UNITS[name]
    return unit, values / size


def _banded(panel: Axes, time: np.ndarray, value: np.ndarray, ends: np.ndarray) -> None:
    """A line with its band; ends have shape (2, n), in either order."""
    panel.fill_between(time, ends.min(axis=0), ends.max(axis=0), color=_BAND, lw=0, label="must stay within")
    panel.plot(*style.thin(time, value), color=style.SIMULATED, lw=1.1, label="expected")


_FUSES = (1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 25.0, 30.0)  # A, common blade fuses
_TELLS = 0.95  # ratio of standard errors below which a test counts as improving a parameter


@dataclass(frozen=True)
class Step:
    """One test on the sheet."""

    # number, title: in the order of the plan
    number: int
    title: str
    how: str  # the played signal
    remark: str  # assumptions, or ""
    wiring: str  # connection and support of the throttle
    watch: tuple[str, ...]  # special instructions
    play: str  # the file to play; "" with open terminals
    record: str  # the file of the record
    logger: Table  # columns, ranges, resolution
    tells: Table  # the parameters that it improves
    facts: str  # seconds, rate, amperes, temperature, pause
    picture: Picture  # the expected curves


def write_sheet(folder: Path, campaign: Campaign) -> Path:
    """Draw PLAN/pictures and write PLAN/procedure.html; return the page's path."""
    steps = [_step(folder, campaign, number, test) for number, test in enumerate(campaign.tests, 1)]
    path = folder / "procedure.html"
    made, current = environment(("etcfit.reporting.plan_sheet", "template")), campaign.settings.current
    page = made.get_template("sheet.html").render(
        rig=campaign.rig.config.name,
        synthetic=campaign.rig.config.synthetic,
        at_fit=campaign.at_fit,
        cautions=campaign.cautions,
        steps=steps,
        minutes=math.ceil((campaign.seconds + sum(t.pause + 120.0 for t in campaign.tests)) / 60.0),
        fuse=next((size for size in _FUSES if size >= current), current),
        supply=campaign.setting.supply,
        limits=_limits(campaign),
        winding=campaign.winding,
        stderr=_stderr(campaign.symbols, campaign.now, campaign.expected, _EXPECTED),
        apart=any(TEST_BY_NAME[t.candidate.plan.test].boundary.gear_apart for t in campaign.tests),
        current=current,
        draws=campaign.settings.draws,
        hot=_hottest(campaign),
    )
    write_text(path, page)
    return path


def _hottest(campaign: Campaign) -> float:
    return max(t.forecast.hottest(campaign.settings.ambient) for t in campaign.tests)


def _limits(campaign: Campaign) -> Table:
    s, settings = campaign.setting, campaign.settings
    most = max((float(np.abs(t.candidate.played.volts).max()) for t in campaign.tests if t.candidate.played),
               default=0.0)  # fmt: skip
    angles = [_in_window(t) for t in campaign.tests if t.candidate.window is not None]
    rows = [
        ("voltage", f"{s.supply:.3g} V", f"{most:.2f} V"),
        ("current", f"{settings.current:g} A", f"{max(t.forecast.amps for t in campaign.tests):.2f} A"),
        ("winding", f"{settings.temperature:g} °C", f"{_hottest(campaign):.0f} °C"),
    ]
    if angles:
        seen = min(a for a, _ in angles), max(b for _, b in angles)
        allowed, expected = (f"{math.degrees(low):.0f} to {math.degrees(high):.0f}°"
                             for low, high in (s.kept_to(settings.margin), seen))  # fmt: skip
        rows.append(("plate while driven", allowed, expected))
    return of_texts("Limits, and the worst expected of them", ("", "limit", "worst expected"), rows)


def _in_window(test: PlannedTest) -> tuple[float, float]:
    window, angle = test.candidate.window, test.forecast.shown["position"]
    assert window is not None
    inside = angle[:, (test.forecast.time >= window[0]) & (test.forecast.time <= window[1])]
    return float(inside.min()), float(inside.max())


def _step(folder: Path, campaign: Campaign, number: int, test: PlannedTest) -> Step:
    name, played = test.candidate.plan.test, test.candidate.played
    path = folder / "pictures" / f"plan_{number}.png"
    draw_one(path, partial(draw, test, campaign, number))
    rate = 1.0 / float(test.candidate.plan.time[1] - test.candidate.plan.time[0])
    facts = [f"{short(test.candidate.seconds, 2)} s", f"log at {rate:.0f} Hz or more",
             f"up to {test.forecast.amps:.1f} A",
             f"winding up to {test.forecast.hottest(campaign.settings.ambient):.0f} °C"]  # fmt: skip
    heads = ("header", "from", "to", "resolution or finer")
    logged = [(c.header, short(c.low, 3), short(c.high, 3), short(c.resolution, 2)) for c in logger(test, campaign)]
    pause = f"then wait {test.pause:.0f} s for the winding to cool" if test.pause >= 1.0 else "no pause needed after it"
    return Step(
        number,
        TEST_BY_NAME[name].title,
        test.candidate.plan.says,
        campaign.remark(test),
        _wiring(name),
        tuple(_watch(name, test)),
        "" if played is None else f"play/plan_{number}.csv, or the sketch play/plan_{number}/plan_{number}.ino",
        f"measurements/{test.file}",
        of_texts("Logger: columns of the CSV, range, resolution", heads, logged),
        _stderr(campaign.symbols, test.before, test.after, "What it will tell: standard errors, %", _TELLS),
        ", ".join(facts) + "; " + pause,
        carried(path),
    )


def _wiring(name: str) -> str:
    boundary = TEST_BY_NAME[name].boundary
    if boundary.gear_apart:
        return ("Gear apart: the motor runs alone. Bridge → fuse → current sensor → motor; speed sensor on its shaft; "
                "voltage sensed at the motor's terminals.")  # fmt: skip
    if boundary.terminals_open:
        return (
            "Bridge disconnected: nothing but the logger's voltage input on the motor's terminals; position sensor on."
        )
    held = " Plate blocked by a wooden wedge so that it cannot move." if boundary.plate_held else ""
    return ("Supply → fuse → bridge → current sensor → motor. Voltage sensed at the motor's own terminals, position "
            f"sensor on the logger's reference.{held}")  # fmt: skip


def _watch(name: str, test: PlannedTest) -> Iterator[str]:
    boundary = TEST_BY_NAME[name].boundary
    if boundary.released:
        yield "Hold the plate open with a rod, start the log, pull the rod away: it slams shut. No fingers inside."
    if boundary.plate_held:
        yield "A held motor makes no back-EMF: the current is the whole voltage over R_a, and all of it is heat."
    if boundary.gear_apart:
        yield "The bare motor runs up at once: fasten it, nothing loose near the shaft."
    if test.candidate.window is not None:
        a, b = test.candidate.window
        yield (f"From {a:.1f} to {b:.1f} s the plate must touch no stop. If it does, if the current leaves its band, "
               "or if nothing moves by 1 s, stop: it is not the rig that this plan was made for.")  # fmt: skip


_EXPECTED = "Standard errors now and expected after all tests, %"


def _stderr(symbols: tuple[str, ...], before: np.ndarray, after: np.ndarray, title: str, below: float = 2.0) -> Table:
    """One row per parameter whose standard error shrinks to less than `below` times what it is."""
    rows = [(s, 100.0 * float(b), 100.0 * float(a), f"{a / b:.2f}")
            for s, b, a in zip(symbols, before, after, strict=True) if a < below * b]  # fmt: skip
    return Table(title, (Column("parameter", 0, "symbol"), Column("now", 1, digits=2), Column("expected", 2, digits=2),
                         Column("expected/now", 3)), rows)  # fmt: skip
