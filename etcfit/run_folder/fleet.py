"""RUN/fleet.json and RUN/units.parquet, and the parts of one design that they hold, as formats.md has them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import __version__
from ..errors import UsageError, command, require_extra
from ..estimation.fitted_model import FleetModel, PopulationLaw, fleet_model
from ..estimation.intervals import LUMPS
from ..files import plain, whole, write_json
from ..fleets.config import Member
from ..fleets.line import FIGURE_BY_NAME, FigureResult, Spread
from ..fleets.statistics.capability import Capability, Gauge
from ..fleets.statistics.charts import DECISION, Chart, Drift, run_length
from ..fleets.statistics.odd import EffectInFleet, OddUnit, TraceScore
from ..fleets.study import FleetStudy
from ..fleets.unit import FailedUnit
from ..model.parameters import Real
from ..problem.free_parameters import Layout, free_parameters
from ..rig.config import parse_config
from ..rig.toml import Toml, written
from .commit import settle
from .declared import SYNTHETIC, VERSIONS, Record, by_name, key, list_of, record_of
from .manifest import FLEET
from .reading import object_in

if TYPE_CHECKING:
    import pandas as pd

    from ..control.fleet import Parts

UNITS = "units.parquet"
_COLUMNS = ("unit", "symbol", "value", "stderr", "low", "high", "status", "shrunk_value", "shrunk_stderr")


@dataclass(frozen=True, eq=False)
class FleetFiles:
    """What lies in the run folder of a fleet."""

    content: Mapping[str, Any]
    units: pd.DataFrame  # units.parquet, one row a unit and symbol


def save_fleet(run: Path, study: FleetStudy, rig: Toml, pages: Mapping[str, str]) -> None:
    """Write both files, each whole or not at all.

    Args:
        rig: tables of one unit's rig.toml, for whoever designs for the fleet.
        pages: odd unit -> its page, below the run folder.
    """
    import pandas as pd

    frame = pd.DataFrame(list(_rows(study)))
    with whole(run / UNITS) as draft:
        frame.to_parquet(draft, index=False)
    write_json(run / FLEET, "fleet", fleet_json(study, rig, pages))


def read_fleet_files(run: Path) -> FleetFiles:
    """What `save_fleet` left.

    Raises:
        UsageError: it is not there or not whole, another version wrote it, or pyarrow is not installed.
    """
    require_extra("fleet", f"{run / UNITS}", "pyarrow")
    settle(run)
    if not (run / FLEET).is_file() or not (run / UNITS).is_file():
        raise UsageError(f"{run} holds no fleet ({FLEET} and {UNITS} are not both there). "
                         f"Run `{command('fleet', 'FLEET', '--out', run)}` first.")  # fmt: skip
    again = f"Run `{command('fleet', 'FLEET', '--out', run)}` again: what it fitted is kept."
    content = object_in(run / FLEET, "fleet", STUDY.required, again)
    if str(content["version"]).split(".")[:2] != __version__.split(".")[:2]:
        raise UsageError(f"{run} was written by etcfit {content['version']}, and this is {__version__}. {again}")
    return FleetFiles(content, _table(run / UNITS, again))


def _table(path: Path, again: str) -> pd.DataFrame:
    """units.parquet, with the columns of `_rows`."""
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pyarrow's own are among them
        raise UsageError(f"{path} cannot be read ({error}). {again}") from None
    if missing := [name for name in _COLUMNS if name not in frame]:
        raise UsageError(f"{path} lacks {', '.join(missing)}. {again}")
    return frame


def model_in(files: FleetFiles) -> FleetModel:
    """The units as models, with the population that they are from."""
    text = str(files.content["rig_toml"])
    rig = parse_config(text, "rig.toml")
    known = free_parameters(rig)
    table = files.units.pivot(index="unit", columns="symbol", values="shrunk_value").loc[files.content["units"]]
    values = {symbol: table[symbol].to_numpy(dtype=float) for symbol in known.layout.free if symbol in table}
    noise, law = float(files.content["position_noise"]), _law(files.content, known.layout)
    return fleet_model(rig, known, files.content["units"], values, noise, law)


def _law(content: Mapping[str, Any], layout: Layout) -> PopulationLaw:
    """That of the population; a mean without an interval is taken to be exact."""
    from scipy.stats import t

    found, units = content["population"], len(content["units"]) - len(content["left_out"])
    reach = float(t.ppf(0.5 + 0.5 * content["settings"]["population"]["level"], max(units - 1, 1)))
    ends = np.array([each["mean_ci95"] or (None, None) for each in found.values()], dtype=float)  # null becomes NaN
    domains = {parameter.symbol: parameter.domain for parameter in layout.parameters}
    return PopulationLaw(
        symbols=tuple(found),
        mean=np.array([each["mean"] for each in found.values()]),
        sd=np.array([each["sd"] for each in found.values()]),
        stderr=np.nan_to_num((ends[:, 1] - ends[:, 0]) / (2.0 * reach)),
        correlation=np.array(content["correlation"]["matrix"]),
        positive=np.array([not isinstance(domains.get(symbol), Real) for symbol in found]),
        units=units,
    )


def _rows(study: FleetStudy) -> Iterator[dict[str, Any]]:
    """One row a unit and symbol; a symbol that the fleet does not tell has no shrunk value."""
    place = {symbol: k for k, symbol in enumerate(study.shrunk.symbols)}
    by_design = dict(study.model.values) | {symbol: study.shrunk.estimate[:, k] for symbol, k in place.items()}
    for u, unit in enumerate(study.fitted):
        for symbol, known in unit.parameters.items():
            yield {
                "unit": unit.unit, "symbol": symbol, "value": known.value, "stderr": known.stderr, "low": known.low,
                "high": known.high, "status": known.status,
                "shrunk_value": float(by_design[symbol][u]) if symbol in by_design else np.nan,
                "shrunk_stderr": float(study.shrunk.stderr[u, place[symbol]]) if symbol in place else np.nan,
            }  # fmt: skip


class _Written(NamedTuple):
    study: FleetStudy
    rig: Toml
    pages: Mapping[str, str]


def fleet_json(study: FleetStudy, rig: Toml, pages: Mapping[str, str]) -> dict[str, Any]:
    """The object of fleet.json."""
    return plain(STUDY.written(_Written(study, rig, pages)))


def _unit_of(study: FleetStudy, symbol: str) -> str:
    if symbol in LUMPS:
        return LUMPS[symbol].unit
    if symbol in FIGURE_BY_NAME:
        return FIGURE_BY_NAME[symbol].unit
    return next((unit.parameters[symbol].unit for unit in study.fitted if symbol in unit.parameters), "1")


def _with_unit(study: FleetStudy, symbol: str, found: Any) -> dict[str, Any]:
    return {**vars(found), "unit": _unit_of(study, symbol)}


def _with_units(study: FleetStudy, found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    return {symbol: _with_unit(study, symbol, each) for symbol, each in found.items()}


def _members(of: _Written) -> dict[str, dict[str, Any]]:
    odd, members = {unit.unit for unit in of.study.odd}, of.study.config.members
    return {
        each.unit: vars(each) | {
            "member": members[each.unit], "odd": each.unit in odd, "page": of.pages.get(each.unit)
        }
        for each in of.study.fitted
    }  # fmt: skip


def _population(study: FleetStudy) -> dict[str, dict[str, Any]]:
    found = study.population
    return {
        symbol: {
            "mean": found.mean[k], "sd": found.sd[k], "mean_ci95": found.mean_interval[k],
            "sd_ci95": found.sd_interval[k], "unit": _unit_of(study, symbol),
            "cpk": study.capability[symbol].cpk if symbol in study.capability else None,
            "shared": bool(found.shared[k]), "informed": int(found.informed[k]),
        }
        for k, symbol in enumerate(found.symbols)
    }  # fmt: skip


def figures_over(
    units: tuple[str, ...], measured: Mapping[str, FigureResult], odd: Collection[str] = ()
) -> dict[str, dict[str, Any]]:
    """Each figure of every unit of which it can be told, and over the ordinary ones; `why` it cannot of the others.

    Args:
        measured: what `fleets.line.measured` gave.
        odd: names of units that do not count in mean and spread.
    """
    ordinary = ~np.isin(units, list(odd))
    return {
        name: {
            **vars(Spread.over_units(FigureResult(told.value[ordinary], told.why), FIGURE_BY_NAME[name].unit)),
            "meaning": FIGURE_BY_NAME[name].meaning,
            "value": {unit: float(v) for unit, v in zip(units, told.value, strict=True) if np.isfinite(v)},
        }
        for name, told in measured.items()
    }


FAILED = record_of(FailedUnit, without=("digest",), meaning="One unit.")
UNFINISHED = Record("One unit.", unit=FAILED.keys["unit"], why=FAILED.keys["why"].taken_from("reason"))
MEMBER = Record(
    "One unit.",
    **record_of(
        Member,
        date=key("text?", "When it was measured, ISO 8601.", lambda member: member.date and member.date.isoformat()),
    ).within("member"),
    chi2_per_dof=key("number?", "Of the whitened residual of its own fit; 1 where only noise is left."),
    converged=key("flag", "Whether its fit is at an optimum."),
    seconds=key("number?", "That its fit took."),
    odd=key("flag", "Whether it is among `odd`."),
    page=key("text?", "Its own report, relative to RUN; null where none was made."),
    warnings=key("[text]", "What a reader of its fit must know."),
)  # fmt: skip
POPULATION = Record(
    "One parameter.",
    mean=key("number?", "Of the units."),
    sd=key("number?", "Standard deviation between units; 0 of a shared parameter."),
    mean_ci95=key("[number?]?", "95 % interval of the mean.", minItems=2, maxItems=2),
    sd_ci95=key("[number?]?", "95 % interval of the standard deviation.", minItems=2, maxItems=2),
    unit=key("text", "Unit of measure, SI."),
    cpk=key("number?", "Against the specification limits; null without any."),
    shared=key("flag", "One value for all units, estimated jointly."),
    informed=key("whole?", "Number of units whose data tell it."),
)  # fmt: skip
CORRELATION = Record(
    symbols=key("[text]", "Rows and columns."),
    matrix=key("[[number?]]", "Row by row; null where it is not known.", "correlation"),
)  # fmt: skip
UNIT = key("text", "Unit of measure, SI.")
TRACE = record_of(TraceScore, null=("misfit", "z"))
ODD = record_of(
    OddUnit, null=("p", "rate", "drives", "misfit"), traces=key(list_of(TRACE), "The traces that make it odd.")
)
EFFECT = record_of(EffectInFleet, null=("median", "strength"), without=("effect", "p"), unit=key("text?", UNIT.meaning))
DRIFT = record_of(
    Drift, null=("size_sd", "p"), since=key("text", "First unit after it; of a trend the first of all."), unit=UNIT
)
_OF_EACH_UNIT = key("[number?]", "Of each unit, in the chart's order, SI.")
CHART = record_of(
    Chart,
    null=("centre", "sd"),
    called={"units": "order"},
    units=key("[text]", "Names of the units, in the chart's order; every list below goes by it.", "units"),
    value=_OF_EACH_UNIT,
    stderr=_OF_EACH_UNIT,
    lower=key("number?", "Lower control limit of a unit known as well as most, SI; of one known worse it is further "
        "out.", lambda chart: float(np.median(chart["lower"]))),
    upper=key("number?", "Upper control limit, likewise.", lambda chart: float(np.median(chart["upper"]))),
    cusum_high=key("[number?]", "Cumulative sum above the centre, in standard deviations."),
    cusum_low=key("[number?]", "Cumulative sum below the centre, in standard deviations."),
    decision=key("number?", "Cumulative sum beyond which the process has moved.", lambda _: DECISION),
    run_length=key("number?", "Mean number of units between false alarms of the cumulative sums.",
        lambda _: run_length()),
    unit=UNIT,
)  # fmt: skip
CAPABILITY = record_of(
    Capability, null=("low", "high", "mean", "sd", "cp_ci95", "cpk", "cpk_ci95", "outside", "outside_ci95"), unit=UNIT
)
GAUGE = record_of(Gauge, null=("repeatability", "part", "total", "rr_percent", "ndc"), unit=UNIT)
SPREAD = record_of(Spread)
FIGURE = Record(
    "One figure.",
    meaning=key("text", "In words."),
    **SPREAD.keys,
    value=key("{number?}", "By unit; null where it has none."),
)  # fmt: skip
PREDICTION = Record(
    "One condition.",
    condition=key("text", "In words.", "condition.name"),
    winding_C=key("number", "Temperature of the winding, degrees Celsius.", "condition.winding"),
    supply_V=key("number", "Supply, V.", "condition.supply"),
    friction=key("number", "Dry friction over that of the bench.", "condition.friction"),
    figures=key(by_name(SPREAD), "By name."),
)  # fmt: skip
STUDY = Record(
    "Many units of one design: the population, odd units, drift and what they can: written by `etcfit fleet`.",
    version=key("text", "Version of the program.", lambda _: __version__),
    name=key("text?", "Name of the fleet, from fleet.toml.", "study.config.name"),
    synthetic=SYNTHETIC.taken_from("study.synthetic"),
    units=key("[text]", "Every unit with a result, in the order of units.csv, else by name.",
        lambda of: [unit.unit for unit in of.study.fitted]),
    failed=key(list_of(FAILED), "Units without a result.", "study.failed"),
    not_converged=key(list_of(UNFINISHED), "Units whose fit has a result but is not at an optimum.",
        lambda of: [unit for unit in of.study.fitted if not unit.converged]),
    members=key(by_name(MEMBER), "What is known of each unit, by name.", _members),
    population=key(by_name(POPULATION), "By symbol: how the units are spread, their own uncertainty taken off.",
        lambda of: _population(of.study)),
    uninformed=key("[text]", "Symbols that no unit's data tell; they are in nothing above or below.",
        "study.population.uninformed"),
    left_out=key("[text]", "Units that mean, spread and correlation were estimated without, for they are unlike the "
        "others.",
        lambda of: [unit.unit for unit in of.study.fitted if unit.unit not in of.study.population.units]),
    correlation=key(CORRELATION, "Between the units' parameters.", "study.population"),
    odd=key(list_of(ODD), "Units that stand out, the oddest first.", "study.odd"),
    effects=key(by_name(EFFECT), "By name: effects that units have beyond Eqs. 1-2.",
        lambda of: {each.effect: _with_unit(of.study, each.symbol, each) for each in of.study.effects}),
    drift=key(list_of(DRIFT), "Changes over the order of the charts.", lambda of: [
        _with_unit(of.study, each.symbol, each) | {"since": of.study.fitted[each.since].unit}
        for each in of.study.drifts]),
    charts=key(by_name(CHART), "By symbol: control chart and cumulative sums.",
        lambda of: _with_units(of.study, of.study.charts)),
    capability=key(by_name(CAPABILITY), "By parameter or figure that has specification limits.",
        lambda of: _with_units(of.study, of.study.capability)),
    gauge=key(by_name(GAUGE), "Repeatability and reproducibility, by symbol; null where no part was measured again. "
        "Standard deviations.", lambda of: _with_units(of.study, of.study.gauge) or None, null=True),
    figures=key(by_name(FIGURE), "By name: what a line measures, from each unit's fitted model.",
        lambda of: figures_over(of.study.model.units, of.study.figures, {unit.unit for unit in of.study.odd})),
    predictions=key(list_of(PREDICTION), "The figures in other conditions.", "study.predictions"),
    settings=key("object", "`FleetSettings`: what population, charts, oddness and effects were decided by.",
        "study.settings"),
    rig_toml=key("text", "Tables of one unit's rig.toml, what is common laid under them: what `etcfit design --fleet` "
        "builds the units from.", lambda of: written(of.rig)),
    position_noise=key("number", "Standard deviation of the position sensor that a design counts on, rad.",
        "study.model.position_noise"),
    versions=VERSIONS,
)  # fmt: skip


def parts_of(run: Path) -> Parts:
    """The parts of one design that a fleet found, for the design of one of them.

    What the fleet's population leaves out, and what has no result or none that converged, is none of them: its values
    are not known, or it is something else.

    Raises:
        UsageError: see `read_fleet_files`; too few units to say how parts scatter.
    """
    from ..control.fleet import FEWEST_UNITS, Parts

    files = read_fleet_files(run)
    model, left_out = model_in(files), _left_out(files.content)
    if model.law.units < FEWEST_UNITS:
        raise UsageError(f"{run}: its population is known from {model.law.units} units, too few to say how parts "
                         f"scatter. Measure {FEWEST_UNITS} at least, and run `etcfit fleet` again.")  # fmt: skip
    kept = np.flatnonzero([unit not in left_out for unit in model.units])
    if not kept.size:
        raise UsageError(f"{run} holds no unit whose fit can be trusted. The page fleet.html says why of each.")
    return Parts(str(run), str(files.content["name"]), model.taking(kept), left_out)


def _left_out(content: Mapping[str, Any]) -> dict[str, str]:
    """Units that are none of the parts, with why."""
    odd = {each["unit"]: f"odd: {each['why']}" for each in content["odd"]}
    apart = {unit: odd.get(unit, "too far from the others") for unit in content["left_out"]}
    failed = {each["unit"]: f"no result: {each['why']}" for each in content["failed"]}
    return apart | {each["unit"]: f"did not converge: {each['why']}" for each in content["not_converged"]} | failed
