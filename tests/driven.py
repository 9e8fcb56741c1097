"""Angles of driven responses of the independent generator, of which friction and spring are sought."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace, prepare
from etcfit.rig.base import Fixed, Rig
from etcfit.rig.reader import read_folder
from independent import Truth
from independent.folder import make_folder

SOUGHT = ("K_s", "T_PL", "T_f")


def driven_rig(truth: Truth, folder: Path) -> Rig:
    """A rig with all but `SOUGHT` known, Eqs. 1-2."""
    make_folder(folder, truth, 1, size="small")
    rig = read_folder(folder)
    known = {s: Fixed(getattr(truth, s)) for s in ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L")}
    return replace(rig, config=replace(rig.config, parameters=known, series_ohm={}))


def driven(rig: Rig, start: Mapping[str, float]) -> EstimationProblem:
    """Its responses' angles beside the model, integrated finely enough at `start`, SI by symbol; what is not there is
    nominal."""
    traces = [prepare(m, rig.config) for m in rig.measurements if m.test == "response"]
    known = free_parameters(rig.config)
    angles = tuple(_angle_alone(trace) for trace in traces if trace is not None)
    problem = EstimationProblem.of_traces(rig.config, known, angles)
    return problem.refined(
        known.layout.coordinates({**{p.symbol: p.nominal for p in known.layout.parameters}, **start})
    )


def _angle_alone(trace: Trace) -> Trace:
    k = trace.channels.index("position")
    return replace(trace, channels=("position",), data=trace.data[:, [k]], sigma=trace.sigma[[k]])


def started(truth: Truth) -> dict[str, float]:
    """Half the true spring and friction, twice the preload: no free run is near."""
    return {"K_s": 0.5 * truth.K_s, "T_PL": 2.0 * truth.T_PL, "T_f": 0.5 * truth.T_f}
