"""A fleet for a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..errors import UsageError
from ..reporting import fleet as tables
from ..rig.base import RigConfig
from .progress import Report, silent
from .views import Card, View, frame

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..control.design import Design
    from ..estimation.fitted_model import FleetModel
    from ..run_folder.fleet import FleetFiles
    from ..run_folder.folder import RunFolder
    from .plots import FleetPlots


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(View):
    """Many units of one design: `etcfit.fleet(FLEET, out=RUN)`, or `etcfit.load(RUN)` of such a run.

    Args:
        run: its run folder.
        files: contents of fleet.json and units.parquet.
        remark: which earlier results could not be taken up, or "".
    """

    run: Path
    files: FleetFiles
    remark: str = ""

    @classmethod
    def in_run(cls, run: str | Path) -> Fleet:
        """The fleet of a run folder.

        Raises:
            UsageError: the folder holds none.
        """
        from ..run_folder.fleet import read_fleet_files  # SciPy's statistics take a second

        return cls(Path(run), read_fleet_files(Path(run)))

    @property
    def units(self) -> pd.DataFrame:
        """One row per unit and symbol: value, stderr, low, high, status by the unit's own data (SI), and shrunk_value,
        shrunk_stderr given the population."""
        return self.files.units

    @property
    def members(self) -> pd.DataFrame:
        """The row of units.csv for each unit, and the outcome of its fit, indexed by unit."""
        return pd.DataFrame.from_dict(dict(self._content["members"]), orient="index").rename_axis("unit")

    @property
    def population(self) -> pd.DataFrame:
        """The design, indexed by symbol: mean and sd between units with their 95 % intervals (SI), unit, cpk, whether
        all units share one value, and how many units' data determine it."""
        keys = ("mean", "mean_low", "mean_high", "sd", "sd_low", "sd_high", "unit", "cpk", "shared", "informed")
        return frame(tables.population_table(self._content).rows, "symbol", keys)

    @property
    def correlation(self) -> pd.DataFrame:
        """Correlation between units; rows and columns are symbols."""
        held = self._content["correlation"]
        return pd.DataFrame(held["matrix"], index=held["symbols"], columns=held["symbols"])

    @property
    def odd(self) -> pd.DataFrame:
        """Odd units, the oddest first, indexed by unit: distance, p, symbols, why."""
        return frame(self._content["odd"], "unit", ("distance", "p", "symbols", "why"))

    @property
    def drift(self) -> pd.DataFrame:
        """Changes in the order of the fleet, indexed by symbol: since (the first unit after), kind, size (SI), size_sd,
        p."""
        return frame(self._content["drift"], "symbol", ("since", "kind", "size", "unit", "size_sd", "p"))

    @property
    def charts(self) -> pd.DataFrame:
        """One row per symbol and unit, in order: value, stderr (SI), centre, lower, upper, cusum_high, cusum_low."""
        frames = []
        for symbol, chart in self._content["charts"].items():
            alike = {key: chart[key] for key in ("value", "stderr", "cusum_high", "cusum_low")}
            limits = {key: chart[key] for key in ("centre", "lower", "upper")}
            frames.append(pd.DataFrame({"symbol": symbol, "unit": chart["order"], **alike, **limits}))
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=["symbol", "unit", "value"])

    @property
    def figures(self) -> pd.DataFrame:
        """Figures that a line measures, indexed by figure: mean, sd, low, high (2.5 and 97.5 % of units), unit,
        meaning."""
        return frame(
            tables.figures_table(self._content).rows, "figure", ("mean", "sd", "low", "high", "unit", "meaning")
        )

    @property
    def predictions(self) -> pd.DataFrame:
        """The same figures hot and cold, on a weak battery and a charged one: one row per condition and figure."""
        rows = [{"condition": each["condition"], "figure": name, **figure}
                for each in self._content["predictions"] for name, figure in each["figures"].items()]  # fmt: skip
        return pd.DataFrame(rows, columns=["condition", "figure", "mean", "low", "high", "unit"])

    @property
    def capability(self) -> pd.DataFrame:
        """Quantities with limits, indexed by symbol or figure: low, high, mean, sd, cp, cpk, outside, unit."""
        keys = ("low", "high", "mean", "sd", "cp", "cpk", "outside", "unit")
        return frame(tables.capability_table(self._content).rows, "name", keys)

    @property
    def gauge(self) -> pd.DataFrame:
        """Repeatability and reproducibility, indexed by symbol; empty if no part was measured twice."""
        keys = ("repeatability", "rig", "operator", "reproducibility", "part", "total", "rr_percent", "ndc", "unit")
        return frame(tables.gauge_table(self._content).rows, "symbol", keys)

    @property
    def effects(self) -> pd.DataFrame:
        """Effects of the common model, indexed by effect: number of units with it, of how many, median, unit."""
        return frame(tables.effects_table(self._content).rows, "effect", ("present", "of", "median", "unit", "symbol"))

    @property
    def failed(self) -> pd.DataFrame:
        """Units without a result, indexed by unit, with the reason."""
        return frame(self._content["failed"], "unit", ("why",))

    @property
    def plot(self) -> FleetPlots:
        """Pictures: `plot.population()`, `plot.correlation()`, `plot.charts()`, `plot.odd()`."""
        from .plots import FleetPlots

        return FleetPlots(self.files)

    @property
    def model(self) -> FleetModel:
        """The units as models with their shrunk values, for a design."""
        from ..run_folder.fleet import model_in, read_fleet_files

        return model_in(read_fleet_files(self.run))

    @property
    def page(self) -> Path:
        """RUN/fleet.html."""
        return self.run / "fleet.html"

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions for every result made from this fleet."""
        return ()

    def keep_design(self, run: RunFolder, design: Design, options: Mapping[str, Any], report: Report = silent) -> Path:
        """Write pid.json and the responses.

        Raises:
            UsageError: RUN holds a model, or another fleet.
        """
        from ..files import held, write_json
        from ..reporting import draw_design
        from ..run_folder.commit import all_or_none, settle
        from ..run_folder.manifest import is_fleet, read_records
        from ..run_folder.pid import PID

        to = run.path
        if to.resolve() != self.run.resolve() and (is_fleet(to) or read_records(to)):
            raise UsageError(f"{to} holds results of another fleet than {self.run}, which these gains belong to. "
                             f"Save them to {self.run}, or to another folder.")  # fmt: skip
        with held(to):
            with all_or_none(to) as draft:
                write_json(draft.files / "pid.json", "pid", PID.json(design))
                draw_design(draft.files, design, report)
            settle(to)
        return to

    def printed(self) -> RenderableType:
        return tables.fleet_table(self._content)

    @property
    def _content(self) -> Mapping[str, Any]:
        return self.files.content

    def _card(self) -> Card:
        said = tuple(sentence.text for sentence in tables.verdict(self._content))
        config = RigConfig(self._content["name"], synthetic=self._content["synthetic"])
        return Card(config, f"fleet of {len(self._content['units'])} units", said)
