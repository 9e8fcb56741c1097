"""The page's tables: parameters and errors of the model, the transfer function, what sine traces say, the gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from markupsafe import Markup

from ...control.loop_figures import EFFORT, FIGURES
from ..control.sentence import doubt, state_of, withheld
from ..html import Table, figure, measured, number, polynomial, span, symbol, unit
from ..pool import Pool, grouped
from .contents import Contents, rows_of

LOST, COMPROMISE = "not identifiable", "compromise"


def parameter_table(contents: Contents) -> Table:
    """Every parameter of the final model; one that is not identifiable gets no number."""
    every = contents.final["parameters"]
    rows, marked = [_row(name, p) for name, p in every.items()], _lost(every)
    unsure = any(p["status"] == COMPROMISE for p in every.values())
    return Table("Parameters of the final model" + (_RANGES if unsure else ""), _HEAD, rows, 1, marked)


def influence_table(contents: Contents) -> Table | None:
    """The largest pulls of whole tests and of single traces; of the final model."""
    pulls = contents.final.get("influence") or ()
    rows = [(p["test"].replace("_", " "), p["file"] or "all of it", symbol(p["parameter"]), number(p["pull"]))
            for p in pulls[:_PULLS]]  # fmt: skip
    head = ["test", "left out", "parameter", "moves by, standard errors"]
    return Table("Influence: what leaving out a test or a trace would move most", head, rows, 3) if rows else None


_PULLS = 10  # shown
_RANGES = "; of a compromise the interval is the range that subsets of the data give, not a statistical one"


def lumped_table(contents: Contents) -> Table | None:
    """Combinations that may be known where their parts are not; of the fit, so only where nothing was added to it."""
    lumps = contents.files["fit"].get("lumped") or {}
    if not lumps or contents.added:
        return None
    return Table("Combinations", _HEAD, [_row(name, p) for name, p in lumps.items()], 1, _lost(lumps))


def posterior_table(contents: Contents) -> Table | None:
    """What was sampled, beside the fit's standard error and the profile; what the sampler says of its own chains."""
    posterior = contents.get("posterior")
    draws = posterior.get("parameters") or {}
    if not draws:
        return None
    exact = _AS_EXACT if posterior.get("exact") else ""
    apart = frozenset(k for k, p in enumerate(draws.values()) if p.get("apart"))
    differ = "; in red where fit, profile and posterior differ by more than 20 % in width" if apart else ""
    shown = [name for name, cell in _SAMPLED.items() if any(cell(p) for p in draws.values())]
    rows = [(symbol(name), *(_SAMPLED[head](p) for head in shown)) for name, p in draws.items()]
    return Table(f"Posterior{exact}{differ}", ["", *shown], rows, 1, apart)


_AS_EXACT = ", formulas of effects taken as exact (the intervals above allow for inexact ones)"
_HEAD = ["", "value ± s.e.", "95 % interval", "unit", "graph reading", "status", "meaning"]
_SAMPLED: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    "mean ± s.d.": lambda p: measured(p.get("mean"), p.get("sd")),
    "95 % interval": lambda p: span(p.get("ci95"), p.get("sd")),
    "unit": lambda p: unit(p.get("unit")),
    "s.d. / fit’s s.e.": lambda p: number(p["sd"] / p["laplace_sd"]) if p.get("sd") and p.get("laplace_sd") else "",
    "profile": lambda p: (p.get("profile") or {}).get("kind", ""),
    "effective samples": lambda p: number(p.get("ess"), 4),
    "R̂": lambda p: number(p.get("r_hat"), 4),
    "meaning": lambda p: p.get("meaning", ""),
}


def _lost(every: Mapping[str, Mapping[str, Any]]) -> frozenset[int]:
    return frozenset(k for k, p in enumerate(every.values()) if p["status"] in (LOST, COMPROMISE))


def _row(name: str, p: Mapping[str, Any]) -> tuple[Any, ...]:
    lost = p["status"] == LOST
    value, interval = ("–", "–") if lost else (measured(p["value"], p["stderr"]), span(p["ci95"], p["stderr"]))
    remark = f" ({p['remark']})" if p.get("remark") else ""
    return (symbol(name), value, interval, unit(p["unit"]), number(p.get("reading"), 4), p["status"] + remark,
            p["meaning"])  # fmt: skip


Key = tuple[str, str, str]


def ledger_table(contents: Contents) -> Table:
    """Held-out traces first, then the fitted ones; each channel of each test pooled over its traces; with a diagnosis
    before and after it, else of the fit alone."""
    rows: list[tuple[Any, ...]] = []
    diagnosis, score = contents.get("diagnosis"), contents.files["fit"]["score"]
    for which, part in (("held out", "holdout"), ("fitted", "fit")):
        after = (diagnosis["after"] if diagnosis else score)[part]
        shared = {row["file"] for row in after}  # a trace of another rig has no error afterwards
        before = [row for row in diagnosis["before"][part] if row["file"] in shared] if diagnosis else after
        now = _pools(after)
        for (test, channel, of), was in _pools(before).items():
            if (then := now.get((test, channel, of))) is not None:
                pools = (was, then) if diagnosis else (then,)
                rows.append((test, channel.replace("_", " "), which, was.traces, *(number(p.rms) for p in pools),
                             unit(of), *(number(p.ratio) for p in pools)))  # fmt: skip
    if not diagnosis:
        head = ["test", "channel", "", "traces", "rms", "unit", "rms, σ"]
        return Table("Free-running error of the fit, rms; σ is the noise of one sample", head, rows, 3)
    head = ["test", "channel", "", "traces", "before", "after", "unit", "before, σ", "after, σ"]
    return Table("Free-running error, rms, before and after the diagnosis; σ is the noise of one sample", head, rows, 3)


def _pools(rows: Any) -> dict[Key, Pool]:
    return {key: Pool.of(group) for key, group in grouped(rows_of(rows)).items()}


_SINES = ("trace", "Hz", "cycles", "loop, dB", "phase, °", "outside the sine, %", "plant, dB re 1 rad/V", "phase, °",
         "fitted model, dB", "phase, °", "linear model, dB", "phase, °")  # fmt: skip

_ORDERS = {"closed_loop": "Loop", "plant": "Plant"}


def sines_table(response: Mapping[str, Any]) -> Table | None:
    """A row a trace: the loop and the plant in it as measured, and the plant of both models."""
    points = response.get("points") or ()
    if not points:
        return None
    rows = [
        (
            point["file"],
            number(point["frequency_Hz"]),
            point["cycles"],
            *_response(point["measured"]["closed_loop"]),
            number(100.0 * point["outside_fundamental"]["position"], 2),
            *_response(point["measured"]["plant"]),
            *_response(point["modelled"]["nonlinear_plant"]),
            *_response(point["modelled"]["linear_plant"]),
        )
        for point in points
    ]
    return Table("Response to sines; ± 95 %", _SINES, rows)


def orders(response: Mapping[str, Any]) -> list[str]:
    """What is said of the order of lag, of the loop and of the plant."""
    said = response.get("order") or {}
    return [f"{name}: {said[key]['says']}" for key, name in _ORDERS.items() if said.get(key)]


def _response(value: Mapping[str, Any] | None) -> tuple[str, str]:
    """Magnitude in dB and phase in degrees, with their margins where they were measured."""
    if value is None:
        return "–", "–"
    decibels, degrees = 20.0 * math.log10(value["magnitude"]), math.degrees(value["phase_rad"])
    if "magnitude_ci95" not in value:
        return _fixed(decibels, 2), _fixed(degrees, 1)
    high, late = value["magnitude_ci95"][1], value["phase_ci95_rad"][1]
    more, margin = 20.0 * math.log10(high) - decibels, math.degrees(late) - degrees
    return f"{_fixed(decibels, 2)} ± {number(more, 2)}", f"{_fixed(degrees, 1)} ± {number(margin, 2)}"


def _fixed(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−")


_ECU = {"P": "", "I": "", "D": "", "period_s": "s"}
_GAINS = {"Kp": "{}", "Ki": "({})/s", "Kd": "({}) · s"}  # of the unit of the proportional one
_NOWHERE = ("none", "unknown")  # of ECUs, a place for a table of gains
_POINT_UNITS = {"pct": "%", "deg": "°"}


def formula(plant: Mapping[str, Any]) -> dict[str, Markup] | None:
    """Numerator and denominator of the transfer function."""
    if not plant:
        return None
    return {"num": polynomial(plant["num"]), "den": polynomial(plant["den"])}


def operating_point(plant: Mapping[str, Any]) -> str:
    """Where the plant is linear: each quantity with the unit that its key ends in."""
    about = plant.get("operating_point")
    if not isinstance(about, Mapping):
        return "" if about is None else number(about)
    parts = [(*name.partition("_"), value) for name, value in about.items()]
    return ", ".join(f"{name} {number(value)} {_POINT_UNITS.get(of, of)}".strip() for name, _, of, value in parts)


def plant_table(plant: Mapping[str, Any]) -> Table | None:
    """Coefficients with their standard errors, poles, static gain."""
    if not plant:
        return None
    stderr = plant.get("stderr") or {}
    order = len(plant["den"]) - 1
    rows = [*_coefficients("b", plant["num"], stderr.get("num")), *_coefficients("a", plant["den"], stderr.get("den"))]
    rows = [row for k, row in enumerate(rows) if k != len(plant["num"])]  # the leading one is 1
    rows += [(Markup("pole {}").format(k + 1), pole(*p), "rad/s") for k, p in enumerate(plant.get("poles") or [])]
    gain = f"{unit(plant['output']['unit'])}/{unit(plant['input']['unit'])}"
    rows.append(("open-loop static gain", number(plant.get("open_loop_dc_gain"), 4), gain))
    if found := plant.get("feedforward"):
        rows += [(f"feed-forward {name}", measured(found[name], found["stderr"][name]), found["unit"][name])
                 for name in found["unit"]]  # fmt: skip
    return Table(f"Linear model of order {order}", ["", "value", "unit"], rows)


def _coefficients(letter: str, values: Any, errors: Any) -> list[tuple[Any, ...]]:
    errors = errors or [None] * len(values)
    if len(errors) != len(values):  # the leading coefficient of the denominator has none
        errors = [None] * (len(values) - len(errors)) + list(errors)
    return [(symbol(f"{letter}_{len(values) - 1 - k}"), measured(v, e), "")
            for k, (v, e) in enumerate(zip(values, errors, strict=True))]  # fmt: skip


def pole(real: float, imaginary: float) -> str:
    """a + bj, rad/s."""
    if imaginary == 0.0:
        return number(real, 4)
    return f"{number(real, 4)} {'+' if imaginary > 0.0 else '−'} {number(abs(imaginary), 4)}j"


def gains_table(pid: Mapping[str, Any]) -> Table | None:
    """The gains, and as the ECU wants them; also in the user's own unit and form where rig.toml names these.

    Of a model that is no estimate in SI alone, see `withheld`.
    """
    if not pid:
        return None
    of = str(pid["gains"].get("unit") or "")
    rows = [
        (symbol(f"{name[0]}_{name[1]}"), number(pid["gains"][name], 4), form.format(unit(of)) if of else "")
        for name, form in _GAINS.items()
    ]
    typed_in = {} if withheld(pid) else pid
    own = (pid.get("profile") or {}).get("says")  # an ECU whose unit is not published gets no numbers in ticks
    ecu = {} if own else typed_in.get("ecu") or {}
    rows += [(f"ECU {name.removesuffix('_s')}", number(ecu[name], 4), of) for name, of in _ECU.items()
             if ecu.get(name) is not None]  # fmt: skip
    mine = typed_in.get("as_written") or {}
    rows += [(f"{name}, as [ecu] of rig.toml writes it", number(mine[name], 4), f"{mine['unit']}, {mine['form']}")
             for name in "PID" if mine]  # fmt: skip
    return Table(f"Gains by the rule “{pid.get('rule', '?').replace('_', ' ')}”", ["", "value", "unit"], rows)


def settings_table(pid: Mapping[str, Any]) -> Table | None:
    """What the make of ECU is given that was named, in its own words; None where none was, or nothing may be given."""
    written = pid.get("profile")
    if not written or withheld(pid):
        return None
    settings = (written["gains"] | written["limits"]).items()
    rows: list[tuple[Any, ...]] = [(name, number(each["value"], 5), each["unit"]) for name, each in settings]
    rows += [(name, ", ".join(number(each, 4) for each in row), "%") for name, row in (written["bias"] or {}).items()]
    rows += [("in your own code, each tick", line, "%") for line in written.get("code") or ()]
    return Table(f"Settings for {written['title']}", ["", "value", "unit"], rows)


def assumed(pid: Mapping[str, Any]) -> list[str]:
    """What its gains mean where it publishes no unit, and what is taken of that ECU without a source."""
    written = pid.get("profile") or {}
    return [*written.get("says", ()), *(f"assumed: {each}" for each in written.get("assumed", ()))]


def metrics_table(pid: Mapping[str, Any]) -> Table | None:
    """How the loop does on the linear and on the nonlinear model, and what was asked of it."""
    linear, nonlinear = (pid.get(key) or {} for key in ("linear", "nonlinear"))
    required, met, word = pid.get("requirements") or {}, pid.get("met") or {}, doubt(state_of(pid))
    rows = [
        (
            of.name,
            "" if key in EFFORT else number(linear.get(key)),
            number(nonlinear.get(key)),
            _most(required.get(key)),
            unit(of.unit),
            _met(met, key, word),
        )
        for key, of in FIGURES.items()
        if key in linear or key in nonlinear
    ]
    if not rows:
        return None
    return Table("The loop", ["", "linear model", "nonlinear model", "required", "unit", "met"], rows)


def conditions_table(pid: Mapping[str, Any]) -> Table | None:
    """The proposed gains at the worst corner of what a car has and the bench has not; None where that was not asked."""
    found, required = pid.get("conditions"), pid.get("requirements") or {}
    if not found:
        return None
    word = doubt(state_of(pid))
    rows = [(of.name, _or_never(found["worst"][key]), _most(required.get(key)), unit(of.unit),
             _met(found["met"], key, word))
            for key, of in FIGURES.items() if key in found["worst"]]  # fmt: skip
    return Table("Away from the bench", ["", "worst corner", "required", "unit", "met"], rows)


def conditions_asked(pid: Mapping[str, Any]) -> list[str]:
    """Which conditions those are, where it is hardest, and how many of the models meet everything there."""
    found = pid.get("conditions")
    if not found:
        return []
    supply, winding, friction = (
        " to ".join(map(_plain, found[key])) for key in ("supply_V", "winding_degC", "friction_over_bench")
    )
    hardest = found["hardest"]
    said = (f"Supply {supply} V, winding {winding} °C, dry friction {friction} times the bench's. Hardest at "
            f"{_plain(hardest['supply_V'])} V, {_plain(hardest['winding_degC'])} °C, friction "
            f"{_plain(hardest['friction_over_bench'])}. "
            f"{_percent(found['probability_met'])} % of the models, each under conditions of its own, meet "
            "everything.")  # fmt: skip
    return [said] if found["stable"] else [said, "Not stable at every corner."]


def _plain(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _most(value: float | None) -> str:
    return "" if value is None else f"≤ {figure(number(value))}"


def _met(met: Mapping[str, bool], key: str, word: str) -> str:
    """ "yes" or "NO", of one requirement; a word in their place where the model is no estimate."""
    return "" if key not in met else word or ("yes" if met[key] else "NO")


def supply_table(pid: Mapping[str, Any]) -> Table | None:
    """The gains over the supply; None where the ECU that was named has nowhere to type them, or none were made."""
    written = pid.get("supply_table")
    if not written or written["ecu_has"] in _NOWHERE or withheld(pid):
        return None
    rows = [(name, *(number(gain, 4) for gain in row), f"{written['unit']}, {written['form']}")
            for name, row in written["gains"].items()]  # fmt: skip
    heads = ["", *(f"{supply:g} V" for supply in written["supply_V"]), "unit"]
    return Table("Gains over the supply that keep the loop what it is", heads, rows)


def tables_of_gains(pid: Mapping[str, Any]) -> list[str]:
    """What is said of tables of gains: who has them, what they are worth."""
    return list((pid.get("supply_table") or {}).get("says", ()))


def parts_table(pid: Mapping[str, Any]) -> Table | None:
    """Every rule on the parts of the design; None where no fleet tells them."""
    found = pid.get("parts")
    if not found:
        return None
    rows = [(name.replace("_", " "), *(_percent(each[on]["share_met"]) for on in ("measured", "drawn")),
             *(_or_never(each[on]["worst_rmse_pct"]) for on in ("measured", "drawn")), *_hardest(each["worst"]))
            for name, each in found["rules"].items()]  # fmt: skip
    drawn = next(iter(found["rules"].values()))["drawn"]["of"]
    heads = ["", f"met, % of {len(found['units'])} units", f"% of {drawn} drawn", "largest RMSE, %", "drawn, %",
             "worst unit", "hardest for it", "figure", "limit"]  # fmt: skip
    return Table(f"On the parts of {found['name']}", heads, rows)


def parts_outside(pid: Mapping[str, Any]) -> list[str]:
    """The proposed gains on the parts under the conditions of a car, and which units are none of the parts."""
    found = pid.get("parts")
    if not found:
        return []
    there, (place, name, value, limit) = found["conditions"], _hardest(found["conditions"]["hardest"])
    said = (f"Outside the bench {_percent(there['corners']['share_met'])} % of the measured units meet everything at "
            f"every corner of supply, winding and friction, and {_percent(there['drawn']['share_met'])} % of the drawn "
            f"ones, each under conditions of its own. Hardest: {place}, {name} {value}, limit {limit}.")  # fmt: skip
    return [said, *(f"Not judged: {unit}, {why}" for unit, why in found["left_out"].items())]


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"


def _hardest(worst: Mapping[str, Any]) -> tuple[str, str, str, str]:
    """Unit, requirement, figure and limit."""
    of = FIGURES.get(worst["requirement"], FIGURES["gain_margin_db"])  # a loop that is not stable
    figure = "never" if worst["figure"] is None else f"{number(worst['figure'])} {of.unit}"
    return worst["unit"], of.name, figure, f"{number(worst['limit'])} {of.unit}"


def safety_tables(pid: Mapping[str, Any]) -> list[Table]:
    """What the proposed gains do where something fails; nothing where the file is older than that."""
    safe, trips = pid.get("safety"), {None: "", True: "YES", False: "no"}
    if not safe:
        return []
    sensor = [tuple(_or_never(each[key]) for key in ("opens_pct", "jam_after_s", "jam_opens_pct", "apart_after_s",
                                                     "apart_opens_pct")) for each in safe["sensor"]]  # fmt: skip
    supply = [tuple(_or_never(each[key]) for key in ("opening_pct", "closes_pct", "opens_pct", "back_after_s",
                                                     "integral_pct")) for each in safe["supply"]]  # fmt: skip
    unpowered = [tuple(_or_never(each[key]) for key in ("opening_pct", "open_terminals_s", "shorted_terminals_s"))
                 for each in safe["unpowered"]]  # fmt: skip
    return [
        Table(
            "The position sensor fails at a quarter of the travel",
            ["", "opens to, %", "jam check tells after, s", "opens to, %", "two sensors tell after, s", "opens to, %"],
            [(each["fault"], *cells) for each, cells in zip(safe["sensor"], sensor, strict=True)],
        ),
        Table(
            "The supply sags",
            ["", "held at, %", "falls by, %", "overshoots by, %", "back after, s", "integral, %", "taken for a jam"],
            [(each["name"], *cells, trips[each["false_trip"]])
             for each, cells in zip(safe["supply"], supply, strict=True)],
        ),
        Table(
            "Without a current",
            ["from, %", "open terminals, s", "shorted, s", "rests at, %"],
            [(*cells, " to ".join(str(number(end)) for end in each["rests_pct"]))
             for each, cells in zip(safe["unpowered"], unpowered, strict=True)],
        ),
    ]  # fmt: skip


def jam_check(pid: Mapping[str, Any]) -> list[str]:
    """The jam check that is proposed, its margins, and what holding costs."""
    safe = pid.get("safety")
    if not safe:
        return []
    jam, held = safe["jam"], safe["holding"]
    said = "No jam check is proposed: no threshold leaves room for a timeout that is short enough."
    if jam is not None:
        said = (f"Jam check proposed: an error above {number(jam['error_pct'])} % of the travel for more than "
                f"{number(jam['timeout_s'])} s. A sound throttle is further off for {number(jam['longest_above_s'])} s "
                f"at most ({safe['envelope']['models']} models under the conditions of a car).")  # fmt: skip
    hottest = max(held["winding_W"])
    heat = (f"Holding takes up to {number(hottest)} W in the winding; the full duty against a stop "
            f"{number(held['full_duty_W'])} W.")  # fmt: skip
    known = "" if held["heating_known"] else " How warm it becomes is not known: the model has no winding heating."
    return [said, heat + known]


def _or_never(value: float | None) -> str:
    return "never" if value is None else number(value)
