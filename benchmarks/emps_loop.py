"""EMPS in its own position loop: simulated beside what was measured, on the training file and under the force pulses.

    ETCFIT_DATA=../shared/measured python -m benchmarks.emps_loop RUN [RUN ...]

of runs of `etcfit fit` or `etcfit diagnose`. The servo at each tick, 1 ms, with q_f the mean of the last two positions:

    v = clip(k_v (k_p (q_g - q) - (q_f - q_f before)/T), -10 V, 10 V) + pulse,    force = g_tau v, held over the tick

The limit and the two-tap mean are in the authors' scripts, the law is that of their Simulink model as the repository
meco-group/nlgreyfast translated it, and the log bears it out: from the logged q_g and q it gives the logged v within
3.7 mV rms of 1.54 V on the training file. The model there has a tick of delay; the log shows none, and a force that is
held acts half a tick late, which is what the inverse model finds. Pulses are the file's 5 V, as in the authors' model;
the logged v rises by 5.07 V, with which the force errors there would be 0.14 to 0.16 points smaller.

Errors are those of the authors' script Simulation_EMPS.m: 100 |measured - simulated| / |measured| from sample 50 on, of
the measured position low-passed (Butterworth of fourth order, 100 Hz, no phase) and of the force as it is. The figures
that the script prints were not to be had; the authors' parameters, simulated here in the same loop, stand in for them.
A relative error of position says little: the reference itself is within 0.39 % of the measured position.
Source: Janot, Gautier, Brunot 2019, Data Set and Reference Models of EMPS, and the scripts that came with it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import RenderableType
from scipy.signal import butter, sosfiltfilt

from etcfit.backend import use_compilation_cache
from etcfit.control.pid.loop import Body, Loop
from etcfit.control.setpoint import Setpoint
from etcfit.datasets.base import obtain, read_vectors
from etcfit.datasets.emps import EMPS
from etcfit.model.ecu import Ecu
from etcfit.model.effects import PAPER, State
from etcfit.model.effects.friction import AsymmetricFriction
from etcfit.model.parameters import Scalar
from etcfit.model.throttle import Throttle, catalogue
from etcfit.reporting.blocks import PlainTable, render
from etcfit.reporting.table import of_texts
from etcfit.run_folder.state import load_final

_TICK = 1e-3  # s
_LIMIT = 10.0  # V
_BORDER = 49  # samples left out at the begin
_SMOOTH = butter(4, 100.0 * 2.0 * _TICK, output="sos")
_TYPES = (*PAPER, AsymmetricFriction)
_ROOMY = Body(1.0, -1.0, 1.0)  # m; the sled never reaches an end
# an armature of 1 ohm without inductance or EMF: a drive that makes its force at once
_DRIVE = {"R_a": 1.0, "L_a": 1e-12, "K_b": 0.0}
_NO_MOTOR = {"J_m": 0.0, "B_m": 0.0, "K_s": 0.0}

# M, F_v, F_c, offset; with friction told apart F_v and F_c of either direction, which leave no room for an offset
_ALIKE = {"J_L": 95.1089, "B_L": 203.5034, "T_f": 20.3935, "T_PL": -3.1648, "B_a": 0.0, "T_a": 0.0}
_APART = {"J_L": 95.154, "T_PL": 0.0} | {
    symbol: 0.5 * (plus + sign * minus)
    for pair, plus, minus in ((("B_L", "B_a"), 166.7061, 240.4236), (("T_f", "T_a"), 20.144, 20.6277))
    for symbol, sign in zip(pair, (1.0, -1.0), strict=True)
}
PUBLISHED = {"authors' parameters, friction alike": _ALIKE, "authors' parameters, told apart": _APART}


@dataclass(frozen=True, eq=False)
class Record:
    """One file as it was logged: reference, position (m), drive (V), shape (n,); pulses (V) are in the drive too."""

    reference: np.ndarray
    position: np.ndarray
    drive: np.ndarray
    pulses: np.ndarray

    @property
    def speed(self) -> float:
        """At the first sample, m/s: the log begins in motion."""
        return float(np.gradient(self.position[:3], _TICK, edge_order=2)[0])


class Servo(NamedTuple):
    """1/s, V s/m, and N/V."""

    k_p: Scalar
    k_v: Scalar
    g_tau: Scalar


class _Memory(NamedTuple):
    position: Scalar
    smooth: Scalar


def _tick(servo: Servo, ecu: Ecu, memory: _Memory, setpoint: Scalar, position: Scalar, bias: Scalar) -> Any:
    """The law of the module's head, as `Loop.run` takes it."""
    smooth = 0.5 * (position + memory.position)
    volts = servo.k_v * (servo.k_p * (setpoint - position) - (smooth - memory.smooth) / ecu.period)
    return jnp.clip(volts + bias, -ecu.supply, ecu.supply), _Memory(position, smooth)


def records() -> tuple[Servo, tuple[Record, Record]]:
    """The servo, the training file and the one with pulses."""
    training, pulses = (obtain(source) for source in EMPS.sources)
    servo = Servo(*(float(v[0]) for v in read_vectors(training, "kp", "kv", "gtau")))
    reference, position, drive = read_vectors(training, "qg", "qm", "vir")
    undisturbed = Record(reference, position, drive, np.zeros(drive.size))
    return servo, (undisturbed, Record(*read_vectors(pulses, "qg", "qm", "vir", "pulses_N")))


def follow(throttle: Throttle, servo: Servo, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Simulated position (m) and drive (V) at every sample but the last, under the servo from the first sample on.

    A pulse of p V at the output is a reference p/(k_p k_v) further, as long as the output stays within its limit.
    """
    loop = Loop(jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float)[None], throttle), _ROOMY, Ecu(_TICK, _LIMIT))
    wanted = loop.share(record.reference + record.pulses / (servo.k_p * servo.k_v))
    setpoint = Setpoint(tuple(_TICK * np.arange(wanted.size)), tuple(wanted), ())
    begin = State(0.0, record.position[0], record.speed)
    before = record.position[0] - _TICK * record.speed * np.array([1.0, 1.5])
    path = loop.run(_tick, jax.tree.map(lambda leaf: jnp.asarray([leaf]), servo), _Memory(*before), setpoint, begin)
    volts = np.asarray(path.voltage)[0, 0]
    if np.max(np.abs(volts)) >= _LIMIT:
        raise ValueError(f"the drive reaches its limit of {_LIMIT:g} V: a pulse is no shift of the reference there")
    return np.asarray(path.position)[0, 0], volts


def errors(record: Record, position: np.ndarray, drive: np.ndarray) -> tuple[float, float, float]:
    """Of the position, % and um rms, and of the force, %."""
    inside = slice(_BORDER, position.size)
    place, volts = sosfiltfilt(_SMOOTH, record.position)[inside], record.drive[inside]
    missed = place - position[inside]
    return _percent(missed, place), 1e6 * float(np.sqrt(np.mean(missed**2))), _percent(volts - drive[inside], volts)


def _percent(missed: np.ndarray, measured: np.ndarray) -> float:
    return 100.0 * float(np.linalg.norm(missed) / np.linalg.norm(measured))


def closed_loop(models: Mapping[str, Mapping[str, float]]) -> RenderableType:
    """A table of the errors of each model on both files, below those of the authors' parameters.

    Args:
        models: by name, values in SI by symbol; what they have beyond Eqs. 1-2 and asymmetric friction does not count.
    """
    servo, files = records()
    figures = [f"{file}: {what}" for file in ("training", "pulses") for what in ("position", "rms", "force")]
    heads, texts = ("model", *figures), []
    for name, values in {**PUBLISHED, **models}.items():
        throttle = _throttle(values, servo)
        found = [errors(record, *follow(throttle, servo, record)) for record in files]
        texts.append((name, *(text for e in found for text in (f"{e[0]:.4f} %", f"{e[1]:.2f} um", f"{e[2]:.3f} %"))))
    return PlainTable(of_texts("", heads, texts, 1))


def _throttle(values: Mapping[str, float], servo: Servo) -> Throttle:
    nominal = {symbol: p.nominal for symbol, p in catalogue(_TYPES).items()} | {"T_a": 0.0, "B_a": 0.0}
    known = {symbol: v for symbol, v in values.items() if symbol in nominal}
    return Throttle.build(_TYPES, nominal | _NO_MOTOR | known | _DRIVE | {"K_m": servo.g_tau})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN")
    runs = parser.parse_args().runs
    use_compilation_cache()
    print(render(closed_loop({f"{run}": load_final(run).values for run in runs})))


if __name__ == "__main__":
    main()
