"""Gains, of pid.json, for every view: every rule, the proposed ones in each ECU's own numbers, and their results, also
unit by unit and under failures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as Xml

import numpy as np

from ...control.loop_figures import EFFORT, FIGURES, MARGINS, REQUIRED, TRACKING
from ...control.on_units import STABLE
from ...errors import first_names
from ...model.ecus import ECUS, Pasting, Scheduling, named
from ..blocks import cautioned, rig_title, stacked
from ..numbers import or_never, short
from ..table import Cell, Column, Notes, Part, Table, there
from .sentence import CURE, GAINS, doubt, state_of, withheld

if TYPE_CHECKING:  # a page does not need these modules
    from rich.console import RenderableType

    from ...control.design import Design

Pid = Mapping[str, Any]


def design_parts(pid: Pid) -> list[Part]:
    """All tables and notes on gains for terminal and page."""
    kept = withheld(pid)
    typed = [Notes("Nothing to paste", [CURE])] if kept else [own_units_table(pid), gains_table(pid), *pasted(pid)]
    return there(rules_table(pid), figures_table(pid), how_to_read(pid), refused(pid), *typed, *fleet_parts(pid),
                 loop_table(pid), scenario_table(pid), conditions_table(pid), parts_table(pid),
                 None if kept else supply_table(pid), tables_of_gains(pid), against_effort(pid), *safety_parts(pid),
                 binding(pid))  # fmt: skip


def rule_rows(pid: Pid) -> list[dict[str, Any]]:
    """One record per rule: gains (SI), figures of the nonlinear model, whether it meets everything, why it has none."""
    none, rows = dict.fromkeys((*GAINS, *FIGURES)), []
    for name, rule in (pid.get("rules") or {}).items():
        stable = bool(rule.get("stable", True)) and rule["gains"] is not None
        rows.append({"rule": name, **none, **(rule["gains"] or {}), **(rule["nonlinear"] or {}), "stable": stable,
                     "met": stable and all(rule["met"].values()), "probability_met": rule["probability_met"],
                     "why": rule["why_not"] or ""})  # fmt: skip
    return rows


def rules_table(pid: Pid) -> Table:
    """Gains, and whether they meet the requirements; the state of the fit if the model is no estimate."""
    word, required = doubt(state_of(pid)), pid.get("margins_asked") or {}

    def met(row: Mapping[str, Any]) -> Any:
        if row["Kp"] is None:
            return "-"
        return (word or row["met"]) if row["stable"] else "unstable"

    def margins(row: Mapping[str, Any]) -> Any:  # a loop without margins cannot miss one
        return all(row[symbol] is None or row[symbol] >= required.get(symbol, 0.0) for symbol in MARGINS)

    def chance(row: Mapping[str, Any]) -> str:
        return "-" if row["probability_met"] is None else f"{row['probability_met']:.2f}"

    judged = [Column(head, lambda row, show=show: "-" if word or row["Kp"] is None else show(row), "word")
              for head, show in (("margins", margins), (share_of(pid), chance))]  # fmt: skip
    gains = [Column(f"{name}\n{unit}", name) for name, unit in GAINS.items()]
    return Table("Gains of every rule", (Column("rule", "rule", "name"), *gains, Column("met", met, "word"), *judged),
                 rule_rows(pid))  # fmt: skip


def share_of(pid: Pid) -> str:
    """Name of the share of the models that meets everything."""
    return "units" if (pid.get("posterior") or {}).get("origin") == "fleet" else "P(met)"


def figures_table(pid: Pid) -> Table:
    """Results of every rule's gains on the nonlinear model."""
    columns = [Column(f"{of.heading}\n{of.unit}", symbol) for symbol, of in FIGURES.items() if of.heading]
    rows = [row for row in rule_rows(pid) if row["Kp"] is not None]
    return Table("What they do", (Column("rule", "rule", "name"), *columns), rows)


def how_to_read(pid: Pid) -> Notes:
    """Notes on the figures, the requirements, the models and the ECU."""
    scenarios, required = (pid.get("setpoint") or {}).get("scenarios") or (), pid.get("margins_asked") or {}
    limits = ((FIGURES[symbol], limit) for symbol, limit in (pid.get("requirements") or {}).items()
              if symbol in REQUIRED and limit is not None)  # fmt: skip
    margins = ", ".join(f"{required[symbol]:g} {FIGURES[symbol].unit}" for symbol in MARGINS if symbol in required)
    said = [f"required: {', '.join(f'{of.name} < {limit:g} {of.unit}' for of, limit in limits)}; margins {margins}"]
    if scenarios:
        said = [f"figures are of the nonlinear model, the worst of {len(scenarios)} scenarios; RMSE is the tracking "
                "error on the trapezoid of 5 to 45 % at 1 Hz, or on the log where that is larger; a settling time of "
                "-: not settled before the setpoint changes again; duty %: its standard deviation while the setpoint "
                "rests", *said]  # fmt: skip
    said += _judges(pid)
    known = ((pid.get("rules") or {}).get("as_found") or {}).get("gains")
    if "period_s" in pid["ecu"] and "delay_s" in pid["ecu"]:
        habits = ", ".join(_habits(pid["ecu"]))
        said.append(f"ECU: {habits}" + ("; what the command does not give is [ecu]'s of rig.toml" if known else ""))
    if known:
        said.append("as_found: the gains in the ECU of the logs, from rig.toml or from the fit")
    return Notes("How to read it", said)


def _judges(pid: Pid) -> Iterator[str]:
    """The models in addition to the nominal one."""
    state, over = state_of(pid), pid.get("posterior") or {}
    source = "posterior" if over.get("origin") == "posterior" else "the fit's Laplace approximation"
    if state.compromise is not None:
        source += ", as wide as the ranges that subsets of the data give"
    what = f"share of {over.get('draws')} models whose response meets everything and whose linear loop is stable; "
    if doubt(state):
        yield f"met, margins and P(met) are not said of a model that is not the plant; the draws are from {source}"
    elif over.get("origin") == "fleet":
        yield f"units: {what}the mean unit, on which all other figures are, then extreme and random ones of the fleet"
    elif over.get("draws"):
        yield f"P(met): {what}drawn from {source}"


def _habits(ecu: Mapping[str, Any]) -> Iterator[str]:
    """Clock, delay, filter and limit, then properties that not every ECU has."""
    clock, late, slow = (f"{short(1e3 * ecu[key])} ms" for key in ("period_s", "delay_s", "derivative_filter_s"))
    yield f"ticks of {clock}"
    yield f"delay {late}"
    yield f"derivative filter {slow}"
    yield f"output within {short(ecu.get('duty_limit', 1.0) * ecu['supply_V'])} V"
    says = {
        "input_filter_s": lambda v: f"its input filtered by {short(1e3 * v)} ms",
        "noise_rad": lambda v: f"noise of a reading {short(np.degrees(v), 2)} degrees",
        "integral_limit": lambda v: f"integral within {short(v * ecu['supply_V'])} V",
        "dead_band_rad": lambda v: f"integral still within {short(np.degrees(v))} degrees",
        "divides_by_battery": lambda v: "divided by the battery voltage",
        "slew_V_per_s": lambda v: f"output no faster than {short(v)} V/s",
    }
    yield from (says_it(ecu[key]) for key, says_it in says.items() if ecu.get(key))
    if (weight := ecu.get("setpoint_weight", 1.0)) != 1.0:
        yield f"proportional part of {short(weight)} setpoint - position"
    if (weight := ecu.get("derivative_weight", 1.0)) != 1.0:
        of = f"{short(weight)} setpoint - position" if weight else "the position alone"
        yield f"derivative of {of}"


def refused(pid: Pid) -> Notes:
    return Notes("No gains", [f"{row['rule']}: {row['why']}" for row in rule_rows(pid) if row["why"]])


def own_units_table(pid: Pid) -> Table | None:
    """Every rule's gains in the form of [ecu] of rig.toml: numbers to type in."""
    own = pid.get("as_written")
    if not own or not pid.get("rules"):
        return None
    clock = {"seconds": "I per s, D in s",
             "ticks": f"I and D by the tick of {short(1e3 * pid['ecu']['period_s'])} ms"}  # fmt: skip
    rows = [{"rule": name, **rule["as_written"]} for name, rule in pid["rules"].items() if rule["as_written"]]
    return Table(f"The same gains as [ecu] of rig.toml writes them: {own['unit']}, {clock[own['form']]}",
                 (Column("rule", "rule", "name"), *(Column(name, name, digits=4) for name in "PID")), rows)  # fmt: skip


def gains_table(pid: Pid) -> Table | None:
    """The proposed gains in SI and in the ECU's own numbers; None if no gains are given, see `withheld`."""
    if withheld(pid):
        return None
    made, gains, ecu = pid.get("profile") or {}, pid["gains"], pid["ecu"]
    rows = [("continuous time", *(gains[name] for name in GAINS), "V/rad, s")]
    if not made.get("says"):  # no numbers in ticks for an ECU with an unpublished unit
        rows.append((f"ticks of {short(1e3 * ecu['period_s'])} ms", *(ecu[name] for name in "PID"), "V/rad, ticks"))
        if made:
            each = made["gains"].values()
            rows.append((made["title"], *(one["value"] for one in each), next(iter(each))["unit"]))
    if own := pid.get("as_written"):
        rows.append(("as in rig.toml", *(own[name] for name in "PID"), f"{own['unit']}, {own['form']}"))
    columns = (Column("proposed", 0, "word"), *(Column(name, k, digits=5) for k, name in enumerate("PID", start=1)))
    return Table(f"Gains of {pid['rule']}, found {_ahead(pid)}", (*columns, Column("unit", 4, "word")), rows)


def _ahead(pid: Pid) -> str:
    """The terms of feed-forward in the design."""
    make, terms = pid.get("profile"), (pid.get("feed_forward_terms") or {}).get("terms") or ()
    others = [term for term in terms if term != "spring"]
    if pid.get("feed_forward"):
        said = "with the bias curve"
    elif make and make["bias"] is None:
        said = f"without a bias curve: {make['title']} has none"
    else:
        said = "WITHOUT the bias curve: leave it at 0, or design with --feed-forward"
    return said + (f"; with {' and '.join(others)} put ahead by code of yours" if others else "")


def pasted(pid: Pid) -> list[Part]:
    """Settings to type or paste into the named make of ECU, the meaning of its gains, and the assumptions on it."""
    made = pid.get("profile")
    if not made:
        return [Notes("For no ECU in particular", ["--ecu NAME designs in its own controller and writes what to paste. "
                                                   f"NAME is one of {', '.join(ECUS)}."])]  # fmt: skip
    lines = [line for each in constants(made) for line in Xml.tostring(each, "unicode").splitlines()]
    tune_file = named(made["name"]).pasting is Pasting.TUNE_FILE
    return there(
        Notes(_for(made), lines, code=True) if tune_file else settings_table(pid),
        Notes("What these gains mean", made.get("says") or ()),
        Notes(CODE, made.get("code") or (), code=True),
        Notes("Assumed of it", [f"assumed: {each}" for each in made["assumed"]]),
    )


def _for(made: Mapping[str, Any]) -> str:
    return f"For {made['title']}: {named(made['name']).pasting.value}"


CODE = "Behind its PID, in your own code, at each tick, in %; rate begins at 0 and before at the target"


def constants(written: Mapping[str, Any]) -> Iterator[Xml.Element]:
    """One `<constant>` per setting, as TunerStudio writes them into a .msq.

    Source: .msq files of rusEFI; `digits` are the decimals that TunerStudio shows.
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


def settings_table(pid: Pid) -> Table | None:
    """The settings for the named make of ECU, in its own words; None if none was named, or no gains are given."""
    made = pid.get("profile")
    if not made or withheld(pid):
        return None
    rows = [(name, short(each["value"], 5), each["unit"]) for name, each in (made["gains"] | made["limits"]).items()]
    rows += [(name, " ".join(short(value, 4) for value in row), "%") for name, row in (made["bias"] or {}).items()]
    return Table(_for(made), (Column("setting", 0, "word"), Column("value", 1, "prose"), Column("unit", 2, "word")),
                 rows)  # fmt: skip


def loop_table(pid: Pid) -> Table:
    """Results of the proposed gains on the linear and on the nonlinear model, with the requirements."""
    linear, nonlinear = (pid.get(key) or {} for key in ("linear", "nonlinear"))
    rows = [{"of": of, "linear": "" if symbol in EFFORT else short(linear.get(symbol)),
             "nonlinear": nonlinear.get(symbol), **_asked(pid, symbol, pid.get("met") or {})}
            for symbol, of in FIGURES.items() if symbol in linear or symbol in nonlinear]  # fmt: skip
    ohm = ((pid.get("settings") or {}).get("loop") or {}).get("bridge_ohm")
    return Table(f"The loop with the gains of {pid['rule']}", (
        Column("figure", lambda row: row["of"].name, "word"), Column("linear model", "linear"),
        Column("nonlinear model", "nonlinear"), *_REQUIRED), rows,
        [] if ohm is None else [f"the bridge has {ohm:g} ohm"])  # fmt: skip


_REQUIRED = (Column("required", "required"), Column("unit", lambda row: row["of"].unit, "unit"),
             Column("met", "met", "word"))  # fmt: skip


def _asked(pid: Pid, symbol: str, met: Mapping[str, bool]) -> dict[str, str]:
    """The requirement of a figure, and whether it is met; a word if the model is no estimate."""
    most, word = (pid.get("requirements") or {}).get(symbol), doubt(state_of(pid))
    return {"required": "" if most is None else f"<= {short(most)}",
            "met": "" if symbol not in met else word or ("yes" if met[symbol] else "NO")}  # fmt: skip


def scenario_table(pid: Pid) -> Table:
    """The proposed gains, scenario by scenario."""
    rows = [{"scenario": name, **figures} for name, figures in (pid.get("scenarios") or {}).items()]
    columns = [Column(f"{FIGURES[symbol].heading}\n{FIGURES[symbol].unit}", symbol) for symbol in TRACKING]
    title = f"{pid['rule']} in every scenario (nonlinear model)"
    return Table(title, (Column("scenario", "scenario", "word"), *columns), rows)


def conditions_table(pid: Pid) -> Table | None:
    """The proposed gains at the worst corner of a car's conditions; None if this was not requested."""
    found = pid.get("conditions")
    if not found:
        return None
    rows = [{"of": of, "worst": or_never(found["worst"][symbol]), **_asked(pid, symbol, found["met"])}
            for symbol, of in FIGURES.items() if symbol in found["worst"]]  # fmt: skip
    columns = (Column("figure", lambda row: row["of"].name, "word"), Column("worst corner", "worst"), *_REQUIRED)
    return Table("Away from the bench", columns, rows, _conditions(pid, found))


def _conditions(pid: Pid, found: Mapping[str, Any]) -> list[str]:
    """The conditions, the hardest one, and the share of models that meet everything there."""
    supply, winding, friction = (" to ".join(f"{end:g}" for end in found[key])
                                 for key in ("supply_V", "winding_degC", "friction_over_bench"))  # fmt: skip
    reckons = ("the ECU divides by the battery voltage" if pid["ecu"].get("divides_by_battery") else
               "a duty is a share of the supply that there is")  # fmt: skip
    at, whose = found["hardest"], "units" if share_of(pid) == "units" else "draws"
    met = "met" if found["stable"] and all(found["met"].values()) else "not met"
    said = [f"supply {supply} V, winding {winding} degrees Celsius, dry friction {friction} times the bench's; "
            f"{reckons}: requirements {met} at every corner; {found['probability_met']:.2f} of the {whose}, each under "
            "conditions of its own, meet them",
            f"hardest at {at['supply_V']:g} V, {at['winding_degC']:g} degrees Celsius, friction "
            f"{at['friction_over_bench']:g}"]  # fmt: skip
    return said if found["stable"] else [*said, "not stable at every corner"]


_NOWHERE = (Scheduling.NONE.name.lower(), Scheduling.UNKNOWN.name.lower())


def supply_table(pid: Pid) -> Table | None:
    """The gains over the supply; None if the named ECU has no such table, or none were made."""
    made = pid.get("supply_table")
    if not made or made["ecu_has"] in _NOWHERE or withheld(pid):
        return None
    heads = [Column(f"{supply:g} V", k, digits=4) for k, supply in enumerate(made["supply_V"], start=1)]
    title = f"Gains over the supply that keep the loop what it is, in {made['unit']}, {made['form']}"
    rows = [(name, *row) for name, row in made["gains"].items()]
    return Table(title, (Column("gain", 0, "word"), *heads), rows)


def tables_of_gains(pid: Pid) -> Notes | None:
    """The ECUs with tables of gains, and the benefit of the tables."""
    made = pid.get("supply_table")
    return None if not made or withheld(pid) else Notes("Tables of gains", made.get("says") or ())


def against_effort(pid: Pid) -> Notes | None:
    """The cost of a calmer duty, and the benefit of gains without reserve."""
    points, figures = pid.get("front"), pid.get("nonlinear") or {}
    if points is None:
        return None
    both = ((short(each["rmse_pct"]), short(each["duty_activity_pct"], 2)) for each in (figures, *points))
    (rmse, activity), *others = both
    said = [f"proposed: RMSE {rmse} % at a duty that moves {activity} %"]
    calm = dict.fromkeys(pair for pair, point in zip(others, points, strict=True) if point["met"])
    if calm:
        said.append("with gains that meet all other requirements on the nominal model: RMSE at the duty's movement: "
                    + "; ".join(f"{rmse} % at {activity} %" for rmse, activity in calm))  # fmt: skip
    return Notes("Tracking against effort", said)


def binding(pid: Pid) -> Notes:
    """What prevents any gains from meeting everything."""
    return Notes("Not met. The limits in the way: with any one of these relaxed, the optimum would meet everything",
                 pid.get("limits") or ())  # fmt: skip


def safety_parts(pid: Mapping[str, Any]) -> list[Part]:
    """Jam check and heat in sentences, then one row per failure; empty for older files."""
    safe = pid.get("safety")
    if not safe:
        return []
    settings = pid["settings"]
    return [Notes("Jam check", _jam_words(safe, settings["safety"])), *_tables(safe, settings["safety"]),
            Notes("Holding", _holding_words(safe["holding"], settings))]  # fmt: skip


def _tables(safe: Mapping[str, Any], settings: Mapping[str, Any]) -> list[Table]:
    """Sensor, supply and springs."""
    sensor = (f"The position sensor fails (at {settings['supply']:g} V; two sensors: {pct(settings['apart'])} % apart "
              f"for {settings['apart_for']:g} s; worst of hot and cold, little and much friction)")  # fmt: skip
    crank = " then ".join(f"{v:g} V for {1e3 * t:g} ms" for v, t in
                          zip(settings["crank"], settings["crank_for"], strict=True))  # fmt: skip
    sags = f"The supply sags (dip: {settings['dip']:g} V for {1e3 * settings['dip_for']:g} ms; crank: {crank})"
    trips = {None: "-", True: Cell("YES", "bad"), False: "no"}
    return [
        Table(sensor, (Column("sensor at 25 %", "fault", "word"), *_columns({
            "unchecked\nopens to %": "opens_pct", "jam check\nafter s": "jam_after_s", "jam check\nopens to %":
            "jam_opens_pct", "two sensors\nafter s": "apart_after_s", "two sensors\nopens to %": "apart_opens_pct"})),
            safe["sensor"]),
        Table(sags, (Column("supply", "name", "word"), *_columns({
            "held %": "opening_pct", "falls %": "closes_pct", "overshoots %": "opens_pct", "back s": "back_after_s",
            "integral %": "integral_pct"}), Column("seen as jam", lambda row: trips[row["false_trip"]], "word")),
            safe["supply"]),
        Table("The springs bring it back", (*_columns({
            "no current, from %": "opening_pct", "open terminals s": "open_terminals_s", "shorted s":
            "shorted_terminals_s"}), Column("rests at %", lambda row: " to ".join(map(short, row["rests_pct"])))),
            safe["unpowered"]),
    ]  # fmt: skip


def _columns(shown: Mapping[str, str]) -> list[Column]:
    return [Column(head, lambda row, key=key: or_never(row[key])) for head, key in shown.items()]


def _jam_words(safe: Mapping[str, Any], settings: Mapping[str, Any]) -> list[str]:
    """The proposed pair, the reason, and its margins."""
    seen, check = safe["envelope"], safe["jam"]
    tried = (f"{seen['models']} models, each under conditions drawn for a car, in every scenario: largest error "
             f"{short(seen['largest_pct'])} %")  # fmt: skip
    slowest = f"{settings['within']:g} s with a reserve of {settings['reserve']:g} times"
    if check is None:
        return [tried, f"none proposed: no threshold up to {pct(settings['most'])} % is enough within {slowest}"]
    kept = "no error that was tried lasts so long" if check["sustained_pct"] == 0.0 else (
        f"the largest error that lasts so long is {short(check['sustained_pct'])} %")  # fmt: skip
    detected = ", ".join(
        f"{name} {short(after)} s" for name, after in check["told_after_s"].items() if after is not None
    )
    return [
        tried,
        f"proposed: an error above {short(check['error_pct'])} % for more than {check['timeout_s']:g} s; the smallest "
        f"threshold without a false trip within {slowest}",
        f"no false trip: the error of a sound throttle exceeds it for {short(check['longest_above_s'])} s at most; "
        f"{kept}",
        f"a plate that jams at the first change of a scenario is detected after: {detected or 'never'}; not while the "
        "setpoint stays within the threshold",
    ]


def _holding_words(held: Mapping[str, Any], settings: Mapping[str, Any]) -> list[str]:
    """Current, heat, and the allowed time at full duty."""
    k = int(np.argmax(np.abs(held["current_A"])))
    said = [f"{short(abs(held['current_A'][k]))} A and {short(held['winding_W'][k])} W in the winding at most, at "
            f"{short(held['position_pct'][k])} % of the travel; full duty against a stop: "
            f"{short(held['full_duty_A'])} A, {short(held['full_duty_W'])} W"]  # fmt: skip
    if not held["heating_known"]:
        return [*said, "the model has no winding heating: only the power is known, not the temperature"]  # fmt: skip
    limit = f"{settings['safety']['insulation']:g} degrees Celsius"
    longest = held["full_duty_s"]
    lasts = f"never up to {limit}" if longest is None else f"{short(longest)} s to {limit}"
    return [*said, f"in the long run {short(max(held['winding_rise_K']))} K warmer; full duty from "
            f"{settings['conditions']['bench']:g}: {lasts}"]  # fmt: skip


def pct(share: float) -> str:
    """A share in per cent."""
    return short(100.0 * share)


_NAMED = 12  # largest number of units in a line
_OF = FIGURES | {STABLE: FIGURES["gain_margin_db"]}

_WORST = (
    Column("hardest for it", lambda one: _OF[one["requirement"]].name, "word"),
    Column("figure", lambda one: _with_unit(one, "figure")),
    Column("limit", lambda one: _with_unit(one, "limit")),
)


def _with_unit(one: Mapping[str, Any], key: str) -> str:
    return "never" if one[key] is None else f"{short(one[key])} {_OF[one['requirement']].unit}"


def fleet_parts(pid: Mapping[str, Any]) -> list[Part]:
    """Share that meets everything, what the others miss, and the worst units; empty for a design for one unit."""
    found = pid.get("fleet")
    if not found:
        return []
    said = [found["says"], f"so of {_interval(found)} of such units"]
    if future := found.get("future"):
        met = round(future["share_met"] * future["draws"])
        said.append(f"of {future['draws']} units drawn from the population, which the search did not know, {met} do: "
                    f"{_interval(future)}")  # fmt: skip
    columns = (Column("worst units", "unit", "word"), *_WORST, Column("meets all", "meets", "word"))
    title = f"{pid['rule']} on every unit of the fleet"
    return [Table(title, columns, found["worst"], [*said, *_missed(found["fails"])])]


def _interval(share: Mapping[str, Any]) -> str:
    """A share with its 95 % interval."""
    low, high = share["share_ci95"]
    return f"{_percent(share)} % (95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %)"


def _percent(share: Mapping[str, Any]) -> str:
    return f"{100.0 * share['share_met']:.1f}"


def _missed(fails: Mapping[str, Any]) -> list[str]:
    return [f"{_OF[symbol].name} missed by {len(units)}: {first_names(units, _NAMED)}"
            for symbol, units in fails.items()]  # fmt: skip


def parts_table(pid: Mapping[str, Any]) -> Table | None:
    """Every rule on measured and drawn units, the worst unit by name; None without a fleet of parts."""
    found = pid.get("parts")
    if not found:
        return None
    rows = [{"rule": name, **each["worst"], **each} for name, each in found["rules"].items()]
    drawn = next(iter(found["rules"].values()))["drawn"]["of"]
    columns = (
        Column("rule", "rule", "name"),
        Column(f"met by, % of\n{len(found['units'])} units", lambda row: _percent(row["measured"])),
        Column(f"% of\n{drawn} drawn", lambda row: _percent(row["drawn"])),
        Column("largest RMSE\nof units, %", lambda row: or_never(row["measured"]["worst_rmse_pct"])),
        Column("largest RMSE\nof drawn, %", lambda row: or_never(row["drawn"]["worst_rmse_pct"])),
        Column("worst unit", "unit", "word"),
        *_WORST,
    )
    return Table(f"On the parts of {found['name']}", columns, rows, _words(found, pid["rule"]))


def _words(found: Mapping[str, Any], rule: str) -> list[str]:
    """Notes on the table, and the results of the proposed gains outside the bench."""
    chosen, there = found["rules"][rule], found["conditions"]
    corners, hardest = there["corners"], there["hardest"]
    verdict = "met nevertheless" if hardest["meets"] else "missed"
    return [
        "share that meets everything by a stable loop: of the measured units by their shrunk values, and of units "
        f"drawn from the population of {found['fleet']}; optimal is sought over the latter",
        f"{rule}: {_interval(chosen['drawn'])} of such parts",
        *_missed(chosen["fails"]),
        f"outside the bench: {round(corners['share_met'] * corners['of'])} of {corners['of']} units meet everything at "
        f"every corner of supply, winding and friction; {_percent(there['drawn'])} % of the drawn ones do, each under "
        "conditions of its own",
        f"hardest: {hardest['unit']}: {_OF[hardest['requirement']].name} {_with_unit(hardest, 'figure')}, required "
        f"{_with_unit(hardest, 'limit')}: {verdict}",
        f"not determined by the fleet, taken from the run: {', '.join(found['of_run']) or 'nothing'}",
        *(f"not judged: {unit}, {why}" for unit, why in found["left_out"].items()),
    ]


def design_table(design: Design) -> RenderableType:
    """All rules, then the proposed gains in an ECU's own numbers, with the curve to type in, and their results.

    If the model is no estimate, the caution comes first, and settings of an ECU are left out unless the user requests
    them nevertheless (`Design.withheld`).
    """
    from ...run_folder.pid import PID

    pid = PID.json(design)
    typed = gains_table(pid)
    parts = []
    for part in design_parts(pid):
        parts.append(part)
        if typed is not None and part.title == typed.title:
            parts.append(_curve(design))
    return cautioned(stacked(rig_title(design.fitted.config, "PID gains"), *parts), design.fitted.state)


def _curve(design: Design) -> Table:
    """Duty that holds the plate, and duty at which it begins to move."""
    bias, supply = design.bias, design.task.ecu.supply
    places = 100.0 * np.asarray(design.task.loop.share(bias.angles))
    rows = [(float(place), *(100.0 * float(volts) / supply for volts in each))
            for place, *each in zip(places, bias.hold, bias.opening, bias.closing, strict=True)]  # fmt: skip
    heads = ("position, % of travel", "holding duty %", "opening %", "closing %")
    return Table("Bias curve", [Column(head, k, digits=4) for k, head in enumerate(heads)], rows, [_moving(design)])


def _moving(design: Design) -> str:
    """Voltage of a moving plate in addition to the curve, and the ECUs that can add it."""
    sliding, profile = design.sliding, design.task.profile
    said = (f"a moving plate takes more: dry friction {short(sliding.opening)} V opening, {short(sliding.closing)} V "
            f"closing; back-EMF and drag {short(sliding.slope)} V s/rad of the setpoint's rate")  # fmt: skip
    if design.task.loop.sliding is not None:
        return said
    if profile is not None and not profile.code:
        return f"{said}; {profile.title} has no feed-forward of these"
    return f"{said}; --feed-forward-terms friction,rate puts them ahead where you write the code"
