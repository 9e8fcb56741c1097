"""The data that reading a measurement folder gives: frozen, SI, every channel with its noise."""

from __future__ import annotations

import abc
import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from ..model.ecu import BiasPoints, Ecu, Notation

if TYPE_CHECKING:
    import pandas as pd

FRAMES = "<frames>"  # `folder` of a rig from data frames; no folder has this name by accident

# quantity -> the SI unit it is kept in; the units of `torque` are those at the plate
CHANNELS: dict[str, str] = {
    "voltage": "V",
    "current": "A",
    "position": "rad",
    "emf": "V",
    "motor_speed": "rad/s",
    "setpoint": "rad",
    "duty": "",
    "supply": "V",
    "torque": "N*m",
    "temperature": "degC",
}
DRIVES = ("voltage", "duty", "torque")  # any of them drives the plate
ALLOWED_FOR = frozenset({"synchronous_edges"})  # kinds that are a habit: the fit estimates it, and no mend is needed
SLOW_LOG = "slow_log"  # the kind that makes every diagnosis uncertain


@dataclass(frozen=True, eq=False)
class Channel:
    """One logged quantity on its own time base (empty cells are dropped, so channels may differ)."""

    time: np.ndarray  # s, shape (n,), strictly rising
    value: np.ndarray  # SI unit of `CHANNELS`, shape (n,), finite
    sigma: float  # standard deviation of one sample's noise, SI
    sigma_estimated: bool  # True where rig.toml did not give it
    header: str  # the header of the column in the CSV
    unit: str  # unit in which the user logged it; results are shown in it
    scale: float  # one logged unit in SI (value_SI = scale * logged + offset)
    quantum: float = 0.0  # resolution of the logger, SI; 0 where the data show none
    offset: float = 0.0  # value in SI of a logged 0

    @property
    def name(self) -> str:
        """The header without its unit."""
        return self.header.partition("[")[0].strip() or self.header

    @property
    def error(self) -> float:
        """Standard deviation of one sample, SI: its noise, at least the rounding error of the logger, q/sqrt 12."""
        return max(self.sigma, self.quantum / math.sqrt(12.0))

    def logged(self, value: np.ndarray) -> np.ndarray:
        """SI values in the logged unit."""
        return (value - self.offset) / self.scale


OTHER_RIG = "other_rig"  # kind of the rig effect by whose name traces are set aside


@dataclass(frozen=True, eq=False)
class Measurement:
    """One CSV, one trace."""

    file: str  # path relative to the rig folder, with forward slashes
    test: str  # name of its folder, a rig test
    time: np.ndarray  # the rows' times, s, shape (n,), strictly rising
    channels: Mapping[str, Channel]  # by quantity, see `CHANNELS`
    held_out: bool = False  # whether [holdout] names it: it is then scored, never fitted
    # for each interval between two times 0 or 1, to be added to the phase of edges that are synchronous with the
    # samples, and NaN where there is no such edge, shape (n - 1,); None before edges are evaluated
    edge_turn: np.ndarray | None = None


@dataclass(frozen=True)
class TpsCalibration:
    """Throttle position sensor: linear from `closed_V` at angle 0 to `open_V` at `travel` (rad)."""

    closed_V: float
    open_V: float
    travel: float


@dataclass(frozen=True)
class Fixed:
    """A parameter held at a known value (SI)."""

    value: float


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior (SI)."""

    value: float
    sd: float


@dataclass(frozen=True)
class Start:
    """A nameplate value (SI): the start of the fit if the data give no better one; not a constraint."""

    value: float


@dataclass(frozen=True)
class Tied:
    """Equal to another parameter, as K_m = K_b."""

    to: str


Knowledge = Fixed | Prior | Start | Tied


@dataclass(frozen=True)
class Accuracy:
    """The possible calibration error of one channel, the gear or the clock."""

    relative: float = 0.0  # r, share of the value; half-width or standard deviation, see `distribution`
    absolute: float = 0.0  # a, SI
    # "rectangular": both are half-widths; "normal": both are standard deviations
    distribution: Literal["rectangular", "normal"] = "rectangular"

    @property
    def gain_sd(self) -> float:
        """Standard uncertainty of the gain, relative."""
        return self.relative / self._width

    @property
    def offset_sd(self) -> float:
        """Standard uncertainty of the offset, SI."""
        return self.absolute / self._width

    @property
    def _width(self) -> float:
        return math.sqrt(3.0) if self.distribution == "rectangular" else 1.0


@dataclass(frozen=True)
class RigConfig:
    """rig.toml, validated and in SI."""

    name: str
    synthetic: bool = False
    gear_ratio: float = 1.0
    gear_ratio_given: bool = False
    supply_V: float | None = None
    travel: tuple[float, float] = (0.0, float(np.pi / 2))
    tps: TpsCalibration | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    series_ohm: Mapping[str, float | None] = field(default_factory=dict)  # test -> ohm; None: free
    parameters: Mapping[str, Knowledge] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    holdout: tuple[str, ...] = ()
    ecu: Ecu | None = None
    notation: Notation | None = None  # notation of its gains; None where no unit is named
    bias: BiasPoints = ()  # bias curve of the ECU: rad, and shares of the supply
    accuracy: Mapping[str, Accuracy] = field(default_factory=dict)  # by channel, gear, time, sensor_end_points

    @property
    def stops(self) -> tuple[float, float]:
        """The travel, rad; a quarter turn from zero where the rig has no stops."""
        lower, upper = (end if math.isfinite(end) else None for end in self.travel)
        lower = 0.0 if lower is None else lower
        return lower, lower + math.pi / 2 if upper is None else upper

    @property
    def fixed(self) -> dict[str, float]:
        """Values of the parameters that rig.toml fixes, SI, by symbol."""
        return {symbol: known.value for symbol, known in self.parameters.items() if isinstance(known, Fixed)}

    def sets_aside(self, measurement: Measurement) -> bool:
        """Whether `effects` declares that a trace, or its whole test, is of another rig: it is read but not used."""
        named = {f"{OTHER_RIG}[{place}]" for place in (measurement.file, measurement.test)}
        return not named.isdisjoint(self.effects)


@dataclass(frozen=True)
class Finding:
    """A mistake or a habit of the rig, found in its records."""

    kind: str  # kind of mistake, such as `series_resistance`; the names are part of the contract
    size: float  # its size, in `unit`; the sentence states the quantity
    unit: str  # unit of the size; "" where it has none
    chance: float  # probability that a rig without the mistake shows the same
    found: str  # one sentence: the place, the observation, and the expectation
    mend: str  # the line of rig.toml or the header of the CSV that mends it, or an instruction where no line can
    # test, file, channel: its place; None: all of them
    test: str | None = None
    file: str | None = None
    channel: str | None = None
    sure: bool = False  # whether physics excludes the data for every rig: the fit refuses them

    @property
    def where(self) -> str:
        """File or test, and channel, for a table."""
        return " ".join(part for part in (self.file or self.test or "rig", self.channel) if part)

    def __str__(self) -> str:
        return f"{self.kind}: {self.found} {self.mend}"


@dataclass(frozen=True, eq=False, repr=False)
class Rig:
    """A measurement folder: its rig.toml, its traces in order of file name, and findings."""

    folder: str  # as the user gave it; `FRAMES` where the traces came as data frames
    config: RigConfig
    measurements: tuple[Measurement, ...]
    warnings: tuple[str, ...] = ()
    toml: str = ""  # text of the rig.toml; "" where there is none
    digests: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of every file, or data frame, that was read
    # mistakes and habits of the rig that its records show before any fit; the warnings contain them too
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        tests = ", ".join(sorted({trace.test for trace in self.measurements}))
        data = "SYNTHETIC, " if self.config.synthetic else ""
        return f"Rig({self.config.name!r}, {data}{len(self.measurements)} traces: {tests})"

    @classmethod
    def from_frames(cls, frames: Mapping[str, pd.DataFrame], config: Mapping[str, Any] | RigConfig) -> Rig:
        """The rig in these data frames, with the same checks as for a folder of CSV; for notebooks.

        Args:
            frames: `<test>/<name>` -> columns `quantity [unit]` as in a CSV; NaN is a gap.
            config: the tables of a rig.toml as a dictionary, or the `RigConfig` of a rig.

        Raises:
            MeasurementError: anything in them is wrong; rows are counted from 0, as in `iloc`.
        """
        # imported at the call and by name, because that module imports this one. The constructor is a method of this
        # class, because users look for it here.
        return importlib.import_module("etcfit.rig.frames").rig_from_frames(frames, config)


@dataclass(frozen=True)
class Boundary:
    """The boundary conditions of a rig test, which decide the equations among Eqs. 1-2 that apply."""

    plate_held: bool = False  # the plate cannot move; speed is zero
    terminals_open: bool = False  # no current flows
    gear_apart: bool = False  # the motor runs alone; no plate, spring, dry friction or stops
    released: bool = False  # the plate is held when the trace begins, and released at an instant that is not logged


@dataclass(frozen=True, eq=False)
class Graph:
    """One of the paper's graphs: the points, and the line through them."""

    title: str
    x_label: str
    y_label: str
    x: np.ndarray
    y: np.ndarray
    line_x: np.ndarray
    line_y: np.ndarray
    says: str  # e.g. "slope 1/R_a, R_a = 1.513 ohm"


@dataclass(frozen=True, eq=False)
class Reading:
    """The result of the paper's graph reading of all traces of one rig test."""

    values: Mapping[str, float]  # SI, by symbol; parameters, and where read the lumped `J_eq`, `B_eq`
    graphs: tuple[Graph, ...] = ()  # the graphs, for pictures
    notes: tuple[str, ...] = ()  # symbols that could not be read, with the reason
    # symbols whose scale or split is assumed, not read: usable as a start, not as a reading
    nominal: tuple[str, ...] = ()


class AbstractRigTest(abc.ABC):
    """One rig test of the paper: its boundary conditions, its channels, and the paper's reading."""

    name: ClassVar[str]
    title: ClassVar[str]
    boundary: ClassVar[Boundary]
    observes: ClassVar[tuple[str, ...]]  # channels the model predicts, where they were logged
    needs: ClassVar[tuple[tuple[str, ...], ...]]  # groups of alternative channels, one of each of which is required

    @abc.abstractmethod
    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """The paper's per-graph reading.

        Args:
            traces: every fitted trace of this test.
            known: values read from the tests before this one, and those given in rig.toml, SI.
        """
