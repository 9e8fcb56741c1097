"""Models to be exported, and their C compiled here."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etcfit.estimation.fitted_model import Fitted
from etcfit.exporting import Export, ExportSettings, Source, fmu
from etcfit.model.throttle import catalogue
from etcfit.problem.free_parameters import free_parameters
from etcfit.rig.base import RigConfig, TpsCalibration

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
TPS = TpsCalibration(0.5, 4.5, float(np.pi / 2))
PLATE = {"J_L": 5e-4, "B_L": 1e-3, "T_PL": 0.2, "T_f": 0.15}
# one of each kind: stiff springs, friction that depends on speed and load, memories, impacts, lags and a delay
SEVERAL: Mapping[str, Mapping[str, float]] = {
    "limp_home_spring": {"T_lh": 0.3, "K_lh": 0.5, "theta_lh": 0.15, "d_lh": 0.005},
    "brush_voltage_drop": {"V_b": 0.3},
    "winding_heating": {"r_h": 3e-3, "tau_h": 5.0},
    "actuation_delay": {"t_a": 1.3e-3},
    "torque_saturation": {"S_T": 0.05},
    "stribeck_friction": {"T_s": 0.05, "omega_s": 0.5},
    "load_dependent_friction": {"mu_g": 0.05},
    "presliding_friction": {"T_z": 0.03, "delta_z": 0.005, "tau_z": 1e-3},
    "backlash": {"g_b": 0.01, "t_b": 0.005},
    "stop_bounce": {"e_r": 0.3},
    "position_sensor_lag": {"tau_p": 2e-3},
    "current_sensor_offset": {"I_0": 0.1},
}

needs_a_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler on this machine"
)


def source(
    effects: Mapping[str, Mapping[str, float]] | None = None,
    settings: ExportSettings | None = None,
    pid: Mapping[str, Any] | None = None,
    **config: Any,
) -> Source:
    """A model with these effects and their values; SYNTHETIC."""
    effects = effects or {}
    rig: dict[str, Any] = {"travel": (0.0, float(np.pi / 2)), "tps": TPS, "effects": tuple(effects)} | config
    of = RigConfig("by hand", True, 20.68, True, 12.0, **rig)
    known = free_parameters(of)
    values = {s: p.nominal for s, p in catalogue(known.layout.types).items()} | PLATE
    for changes in effects.values():
        assert set(changes) <= set(values)
        values |= changes
    x = known.layout.coordinates(values)
    return Source(Fitted(of, known, x, 1e-4 * np.eye(x.size)), settings or ExportSettings(), pid)


def compiled(export: Export, folder: Path, *more: str, shared: bool = False) -> Path:
    """A program, or a library, of the C of an export; without a single warning."""
    folder.mkdir(exist_ok=True)
    for name, content in export.files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    target = folder / ("plant.so" if shared else "plant")
    files = ["etcfit_plant.c", *more]
    how = ["-shared", "-fPIC"] if shared else []
    done = subprocess.run([*fmu.compiler(), *STRICT, *how, *files, "-lm", "-o", str(target)], cwd=folder, text=True,
                          capture_output=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return target


_BRIDGE = """
#include "etcfit_plant.h"
#include <stddef.h>
static etcfit_plant plant;
void begin(double angle);
void drive(double voltage, double torque, int steps, double *seen);
void begin(double angle)
{
    etcfit_plant_init(&plant, &etcfit_plant_fitted, angle);
}
void drive(double voltage, double torque, int steps, double *seen)
{
    const etcfit_plant_input input = {voltage, torque};
    etcfit_plant_output output;
    while (steps-- > 0) {
        etcfit_plant_step(&plant, &input, NULL);
    }
    etcfit_plant_read(&plant, &output);
    seen[0] = output.current;
    seen[1] = output.angle;
    seen[2] = output.speed;
    seen[3] = output.sensor_angle;
    seen[4] = output.sensor_current;
    seen[5] = output.sensor_voltage;
}
"""


class CPlant:
    """The C of an export, driven from here: current, angle, speed, then what the sensors show."""

    def __init__(self, export: Export, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        (folder / "bridge.c").write_text(_BRIDGE)
        self.library = ctypes.CDLL(str(compiled(export, folder, "bridge.c", shared=True)))
        self.library.begin.argtypes = [ctypes.c_double]
        self.library.drive.argtypes = [ctypes.c_double, ctypes.c_double, ctypes.c_int, ctypes.c_void_p]

    def begin(self, angle: float) -> np.ndarray:
        """A plate at rest at an angle (rad)."""
        self.library.begin(angle)
        return self.drive(0.0, 0)

    def drive(self, volts: float, steps: int, torque: float = 0.0) -> np.ndarray:
        """So many steps under a voltage (V) and a torque (N m)."""
        seen = np.zeros(6)
        self.library.drive(volts, torque, steps, seen.ctypes.data)
        return seen
