"""A trace beside what the model says of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..errors import UsageError
from ..estimation.result import FitResult
from ..problem.trace import Trace
from ..reporting.table import role
from ..rig.base import Channel


@dataclass(frozen=True, eq=False, repr=False)
class FittedTrace:
    """One measured trace beside what the model says of it.

    Args:
        predicted: free-running simulation, SI, shape (n, M).
        whitened: what the fit minimised, independent of sample to sample where the model is right, sigma, shape (n, M);
            None where the trace was held out.
    """

    trace: Trace
    predicted: np.ndarray
    whitened: np.ndarray | None

    @property
    def file(self) -> str:
        return self.trace.measurement.file

    @property
    def held_out(self) -> bool:
        """Whether it was only predicted, never fitted."""
        return self.trace.measurement.held_out

    @property
    def channels(self) -> tuple[str, ...]:
        """What the model predicts of it."""
        return self.trace.channels

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of `to_frame`."""
        out = {"time": "s"}
        for name in self.channels:
            unit = self._logged(name).unit or "1"
            out |= {self._column(name, "measured"): unit, self._column(name, "simulated"): unit}
            out[self._column(name, "residual")] = "sigma"
        return out

    def to_frame(self) -> pd.DataFrame:
        """One row an instant: time (s), measured and simulated (in the unit that was logged), residual (in sigma).

        The residual is (measured - simulated) over the noise of one sample. Where a trace has several channels each
        has columns of its own, `position_measured` and so on. NaN where nothing was logged. `frame.attrs["units"]`
        names the units.
        """
        columns = {"time": np.array(self.trace.instants)}
        for m, name in enumerate(self.channels):
            logged = self._logged(name)
            measured, simulated = (logged.logged(y[:, m]) for y in (self.trace.data, self.predicted))
            columns[self._column(name, "measured")] = measured
            columns[self._column(name, "simulated")] = simulated
            sigma = float(self.trace.sigma[m]) / abs(logged.scale)
            columns[self._column(name, "residual")] = (measured - simulated) / sigma
        frame = pd.DataFrame(columns)
        frame.attrs = {"file": self.file, "units": self.units}
        return frame

    def _logged(self, name: str) -> Channel:
        """The logged column of a channel; with open terminals the EMF was logged as a voltage."""
        channels = self.trace.measurement.channels
        return channels[name if name in channels else "voltage"]

    def _column(self, name: str, what: str) -> str:
        return what if len(self.channels) == 1 else f"{name}_{what}"

    def __repr__(self) -> str:
        what = f"{role(self.held_out)}, {', '.join(self.channels)}, {self.trace.instants.size} samples"
        return f"FittedTrace({self.file!r}, {what})"


def traces_of(result: FitResult) -> dict[str, FittedTrace]:
    """Every trace of a fit by its file, fitted ones first."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    fitted = zip(result.problem.batch.traces, result.whitened, strict=True)
    every = (*fitted, *((trace, None) for trace in held_out))
    return {t.measurement.file: FittedTrace(t, result.predicted[t.measurement.file], r) for t, r in every}


def named(traces: Mapping[str, FittedTrace], file: str) -> FittedTrace:
    """One of them.

    Raises:
        UsageError: there is no such trace.
    """
    if file not in traces:
        raise UsageError(f"no trace is called {str(file)!r}. There are: {', '.join(traces)}.")
    return traces[file]
