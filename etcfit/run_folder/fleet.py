"""RUN/fleet.json and RUN/units.parquet, and the parts of one design that they hold, as docs/formats.md has them."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..errors import UsageError, command, require_extra
from ..estimation.fitted_model import FleetModel, PopulationLaw, fleet_model
from ..estimation.intervals import LUMPS
from ..files import whole, write_json
from ..fleets.line import FIGURE_BY_NAME, FigureResult, Prediction, Spread
from ..fleets.statistics.charts import DECISION, Chart, run_length
from ..fleets.study import FleetStudy
from ..fleets.unit import UnitResult
from ..model.parameters import Real
from ..problem.free_parameters import Layout, free_parameters
from ..rig.config import parse_config
from ..rig.toml import Toml, written
from .commit import settle
from .fit import versions
from .manifest import FLEET
from .reading import object_in

if TYPE_CHECKING:
    import pandas as pd

    from ..control.fleet import Parts

UNITS = "units.parquet"
_COLUMNS = ("unit", "symbol", "value", "stderr", "low", "high", "status", "shrunk_value", "shrunk_stderr")
_LABELS = ("serial", "batch", "rig", "operator", "part")


@dataclass(frozen=True, eq=False)
class FleetFiles:
    """What lies in the run folder of a fleet.

    Args:
        content: fleet.json.
        units: units.parquet, one row a unit and symbol.
    """

    content: Mapping[str, Any]
    units: pd.DataFrame


def save_fleet(run: Path, study: FleetStudy, rig: Toml, pages: Mapping[str, str]) -> None:
    """Write both files, each whole or not at all.

    Args:
        run: the run folder.
        study: what is known.
        rig: tables of one unit's rig.toml, for whoever designs for the fleet.
        pages: odd unit -> its page, below the run folder.
    """
    frame = units_frame(study)
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
    schema = files("etcfit.run_folder") / "schemas" / "fleet.schema.json"
    needed = json.loads(schema.read_text(encoding="utf-8"))["required"]
    content = object_in(run / FLEET, "fleet", ("version", *needed), again)
    if str(content["version"]).split(".")[:2] != __version__.split(".")[:2]:
        raise UsageError(f"{run} was written by etcfit {content['version']}, and this is {__version__}. {again}")
    return FleetFiles(content, _table(run / UNITS, again))


def _table(path: Path, again: str) -> pd.DataFrame:
    """units.parquet, with the columns that `units_frame` makes."""
    import pandas as pd

    try:
        frame = pd.read_parquet(path)
    except (OSError, ValueError) as error:  # pyarrow's own are among them
        raise UsageError(f"{path} cannot be read ({error}). {again}") from None
    if missing := [name for name in _COLUMNS if name not in frame]:
        raise UsageError(f"{path} lacks {', '.join(missing)}. {again}")
    return frame


def fleet_model_of(run: Path) -> FleetModel:
    """The units of a fleet as models, by their shrunk values, for a design.

    Raises:
        UsageError: see `read_fleet_files`.
    """
    return model_in(read_fleet_files(run))


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


def units_frame(study: FleetStudy) -> pd.DataFrame:
    """One row a unit and symbol; a symbol that the fleet does not tell has no shrunk value."""
    import pandas as pd

    return pd.DataFrame(list(_rows(study)))


def _rows(study: FleetStudy) -> Iterator[dict[str, Any]]:
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


def fleet_json(study: FleetStudy, rig: Toml, pages: Mapping[str, str]) -> dict[str, Any]:
    """The content of fleet.json."""
    odd = {unit.unit for unit in study.odd}
    return {
        "version": __version__,
        "name": study.config.name,
        "synthetic": study.synthetic,
        "units": [unit.unit for unit in study.fitted],
        "failed": [{"unit": unit.unit, "why": unit.why} for unit in study.failed],
        "not_converged": [{"unit": unit.unit, "why": unit.reason} for unit in study.fitted if not unit.converged],
        "members": {unit.unit: _member(study, unit, unit.unit in odd, pages) for unit in study.fitted},
        "population": _population(study),
        "uninformed": study.population.uninformed,
        "left_out": [unit.unit for unit in study.fitted if unit.unit not in study.population.units],
        "correlation": {"symbols": study.population.symbols, "matrix": study.population.correlation},
        "odd": study.odd,
        "effects": {
            each.effect: {
                "units": each.units, "of": each.of, "median": each.median, "symbol": each.symbol,
                "unit": _unit_of(study, each.symbol), "strength": each.strength,
            }
            for each in study.effects
        },
        "drift": [
            {
                "symbol": each.symbol, "since": study.fitted[each.since].unit, "kind": each.kind, "size": each.size,
                "size_sd": each.size_sd, "p": each.p, "unit": _unit_of(study, each.symbol),
            }
            for each in study.drifts
        ],
        "charts": {symbol: _chart(study, symbol, each) for symbol, each in study.charts.items()},
        "capability": {
            name: {"unit": _unit_of(study, name), **asdict(each)}
            for name, each in study.capability.items()
        },
        "gauge": {name: {"unit": _unit_of(study, name), **asdict(each)} for name, each in study.gauge.items()} or None,
        "figures": figures_json(study.model.units, study.figures, odd),
        "predictions": predictions_json(study.predictions),
        "settings": study.settings,
        "rig_toml": written(rig),
        "position_noise": study.model.position_noise,
        "versions": versions(),
    }  # fmt: skip


def _unit_of(study: FleetStudy, symbol: str) -> str:
    if symbol in LUMPS:
        return LUMPS[symbol].unit
    if symbol in FIGURE_BY_NAME:
        return FIGURE_BY_NAME[symbol].unit
    return next((unit.parameters[symbol].unit for unit in study.fitted if symbol in unit.parameters), "1")


def _member(study: FleetStudy, unit: UnitResult, odd: bool, pages: Mapping[str, str]) -> dict[str, Any]:
    member = study.config.members[unit.unit]
    return {
        **{name: getattr(member, name) for name in _LABELS},
        "date": None if member.date is None else member.date.isoformat(),
        "temperature": member.temperature,
        "chi2_per_dof": unit.chi2_per_dof,
        "converged": unit.converged,
        "seconds": unit.seconds,
        "odd": odd,
        "page": pages.get(unit.unit),
        "warnings": unit.warnings,
    }


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


def _chart(study: FleetStudy, symbol: str, chart: Chart) -> dict[str, Any]:
    """The limits are those of a unit that is known as well as most: of one that is known worse they are wider."""
    return {
        "unit": _unit_of(study, symbol), "order": chart.units, "value": chart.value, "stderr": chart.stderr,
        "centre": chart.centre, "sd": chart.sd, "lower": float(np.median(chart.lower)),
        "upper": float(np.median(chart.upper)), "cusum_high": chart.cusum_high, "cusum_low": chart.cusum_low,
        "decision": DECISION, "run_length": run_length(),
    }  # fmt: skip


def figures_json(
    units: tuple[str, ...], measured: Mapping[str, FigureResult], odd: Collection[str] = ()
) -> dict[str, Any]:
    """Each figure of every unit of which it can be told, and over the ordinary ones; `why` it cannot of the others.

    Args:
        units: their names.
        measured: what `fleets.line.measured` gave.
        odd: names of units that do not count in mean and spread.
    """
    ordinary = ~np.isin(units, list(odd))
    return {
        name: {
            "meaning": FIGURE_BY_NAME[name].meaning,
            **asdict(Spread.over_units(FigureResult(told.value[ordinary], told.why), FIGURE_BY_NAME[name].unit)),
            "value": {unit: float(v) for unit, v in zip(units, told.value, strict=True) if np.isfinite(v)},
        }
        for name, told in measured.items()
    }


def predictions_json(predictions: Iterable[Prediction]) -> list[dict[str, Any]]:
    """Every condition with the spread of each figure over the units; figures that can be told of no unit are null."""
    return [
        {
            "condition": each.condition.name,
            "winding_C": each.condition.winding,
            "supply_V": each.condition.supply,
            "friction": each.condition.friction,
            "figures": {name: asdict(figure) for name, figure in each.figures.items()},
        }
        for each in predictions
    ]


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
