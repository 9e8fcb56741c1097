"""A run folder made by hand: a fit's JSON of invented results, small pictures, and what later commands would add."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import results
from etcfit.files import write_json
from etcfit.run_folder.fit import FIT
from etcfit.run_folder.manifest import STAGE_FILES, read_records, replacing
from etcfit.run_folder.state import save_fit

STAGES = {"diagnosis": "diagnose", "posterior": "sample", "transfer_function": "reduce",
          "frequency_response": "reduce", "pid": "design"}  # fmt: skip
LATER = tuple(STAGES)


def run_folder(path: Path, later: tuple[str, ...] = (), synthetic: bool = True, lost: tuple[str, ...] = ()) -> Path:
    """RUN with fit.json and pictures, and those of LATER that are named.

    Args:
        path: an empty folder; the measurements lie beside the run in it.
        later: kinds of files besides fit.json.
        synthetic: what rig.toml says.
        lost: symbols that are not identifiable.
    """
    run = path / "run"
    result = results.result(results.rig(path / "rig", synthetic), lost)
    save_fit(run, result)
    fit = FIT.json(result)
    made = {"diagnosis": _diagnosis, "posterior": _posterior, "transfer_function": _plant,
            "frequency_response": _sines, "pid": lambda fit: pid()}  # fmt: skip
    for kind in later:
        with replacing(run, STAGES[kind], 0, {}) as draft:
            if kind == "frequency_response" and (run / "transfer_function.json").is_file():  # of the same stage
                shutil.copy(run / "transfer_function.json", draft)
            write_json(draft / f"{kind}.json", kind, made[kind](fit))
    for name in ("parameters", "tests/response", "traces/response__1", "diagnosis/ledger", "odd_things/one"):
        picture(run / "pictures" / f"{name}.png")
    return run


def written(run: Path, stage: str, content: str, settings: Mapping[str, Any] | None = None) -> None:
    """A stage whose first file has this content, whatever it is."""
    with replacing(run, stage, 0, settings or {}) as draft:
        (draft / STAGE_FILES[stage].makes[0]).write_text(content, encoding="utf-8")


def picture(path: Path, size: tuple[int, int] = (660, 300), colours: int = 4) -> None:
    """A PNG of stripes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    stripes = np.tile(np.linspace(0, 255, colours).astype(np.uint8), -(-size[0] // colours))[: size[0]]
    Image.fromarray(np.tile(stripes, (size[1], 1))).save(path)


def changed(run: Path, kind: str, **changes: Any) -> None:
    """The same run with some keys of a file replaced."""
    content = json.loads((run / f"{kind}.json").read_text(encoding="utf-8")) | changes
    stage = {"fit": "fit", **STAGES}[kind]
    before = read_records(run)[stage]
    with replacing(run, stage, 0, {}, {} if kind == "fit" else None, before.folder) as draft:
        for name in before.outputs:
            if (run / name).is_file():
                shutil.copy(run / name, draft)
        (draft / f"{kind}.json").write_text(json.dumps(content), encoding="utf-8")


def _diagnosis(fit: dict[str, Any]) -> dict[str, Any]:
    def score(factor: float) -> dict[str, Any]:
        rows = {
            part: [row | {"rms": factor * row["sigma"]} for row in fit["score"][part]] for part in ("fit", "holdout")
        }
        return rows | {"chi2_per_dof": factor**2}

    return {
        "start": {"effects": fit["model"]["effects"]},
        "final": {"effects": [*fit["model"]["effects"], "limp_home_spring"]},
        "rounds": [{"effects": [], "white": False, "evidence": [], "candidates": [], "added": "limp_home_spring",
                    "why": "limp_home_spring explains most <of it>"}],
        "added": ["limp_home_spring"],
        "statements": [{"effect": "limp_home_spring", "acted_on": True,
                        "sentence": "Found: the model lacked limp_home_spring (0.90)."}],
        "ties": [["limp_home_spring", "backlash"]],
        "ties_told_by": ["a slow ramp through the default angle"],
        "unexplained": {"enters": "torque", "depends_on": "angle", "shape": "bump", "size": 0.01},
        "before": score(40.0),
        "after": score(1.05),
        "parameters": fit["parameters"],
        "files": fit["files"],
        "versions": fit["versions"],
    }  # fmt: skip


def _posterior(fit: dict[str, Any]) -> dict[str, Any]:
    known = {s: p for s, p in fit["parameters"].items() if p["stderr"] is not None and p["status"] == "estimated"}
    return {"parameters": {s: {"mean": p["value"], "sd": p["stderr"], "ci95": p["ci95"], "ess": 2100.0, "r_hat": 1.002,
                               "unit": p["unit"], "meaning": p["meaning"], "laplace_sd": 1.3 * p["stderr"],
                               "apart": True, "profile": {"kind": "one-sided"}}
                           for s, p in known.items()}}  # fmt: skip


def _plant(_: dict[str, Any]) -> dict[str, Any]:
    return {
        "input": {"name": "voltage", "unit": "V"},
        "output": {"name": "position", "unit": "rad"},
        "operating_point": {"position_rad": 0.44, "position_pct": 25.2, "voltage_V": 1.5, "current_A": 0.9},
        "num": [2.208e5],
        "den": [1.0, 1033.0, 9.370e4, 1.282e5],
        "poles": [[-1.4, 0.0], [-102.0, 3.0], [-102.0, -3.0]],
        "stderr": {"num": [1e3], "den": [0.0, 2.0, 300.0, 900.0]},
        "open_loop_dc_gain": 1.722,
    }


def _sines(_: dict[str, Any]) -> dict[str, Any]:
    loop = {"magnitude": 1.1, "magnitude_ci95": [1.09, 1.11], "phase_rad": -0.5, "phase_ci95_rad": [-0.51, -0.49]}
    return {
        "points": [{
            "file": "sine/2_Hz.csv", "frequency_Hz": 2.003, "cycles": 7,
            "outside_fundamental": {"setpoint": 0.0, "position": 0.0123, "drive": None},
            "measured": {"closed_loop": loop, "plant": None, "controller": None},
            "modelled": {"nonlinear_plant": None, "linear_plant": {"magnitude": 0.1, "phase_rad": -1.6}},
        }],
        "order": {"closed_loop": {"told": False, "says": "1 frequencies cannot tell <the order>."}, "plant": None},
        "warnings": ["sine/bad.csv: no setpoint among position."],
    }  # fmt: skip


def pid(rule: str = "ziegler_nichols") -> dict[str, Any]:
    """Gains that a rule proposes."""
    metrics = {"overshoot_pct": 18.27, "settling_s": 0.31, "steady_state_error_pct": 0.22, "rmse_pct": 1.53,
               "gain_margin_db": 9.0, "phase_margin_deg": None}  # fmt: skip
    return {
        "rule": rule,
        "gains": {"Kp": 6.017, "Ki": 103.87, "Kd": 0.0871, "unit": "V/rad"},
        "ecu": {"P": 4.0, "I": 0.137, "D": 30.0, "period_s": 0.001},
        "as_written": {"P": 6.5, "I": 0.225, "D": 47.1, "unit": "%/%", "form": "ticks"},
        "linear": metrics,
        "nonlinear": metrics,
        "requirements": {"overshoot_pct": 20.0, "settling_s": 0.2, "steady_state_error_pct": 0.5},
        "met": {"overshoot_pct": True, "settling_s": False, "steady_state_error_pct": True},
        "posterior": {"probability_met": 0.04, "draws": 200},
    }
