"""EMPS by the protocol of its benchmark, and what the figure that comes of it is made of.

    ETCFIT_DATA=../shared/measured python -m benchmarks.emps

The protocol is that of nonlinearbenchmark.org, as its loader (`nonlinear_benchmarks` 0.1.2: `EMPS()`, and
`submission_examples/EMPS.py`) states it: a model is made from DATA_EMPS alone, at 1 kHz, nothing filtered or decimated;
DATA_EMPS_PULSES is simulated from its logged drive `vir` and its first 20 positions; the figure is the rms error of the
position from sample 20 on, mm. So it is here. What differs: of the 20 positions the start is read off the first 10
only, and the drive enters as a force, `gtau` times `vir`, which is a factor. The published figures are those of arXiv
2405.10779 and of what it cites as they were handed to us; the paper itself was not to be had here, so that how those
models were trained is not known. Which effects are in our models was settled on the training record alone.

The other tables say why models that fit the training record within 0.5 mm miss the pulses by 5: a free run of a sled
without a spring integrates every error of force. Parts of one record that are told apart, records that are not told
apart by a gain, friction that differs from session to session, and what 0.1 N or 1 % costs. Rows marked "looked at"
are fitted to data that the protocol holds out; they say what the model's form allows, and no choice rests on them.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import RenderableType

from benchmarks.emps_loop import records
from etcfit.backend import use_compilation_cache
from etcfit.datasets import fetch
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.reporting.blocks import PlainTable, headed, render
from etcfit.reporting.table import of_texts
from etcfit.rig.base import Channel, Fixed, Measurement, Rig
from etcfit.rig.inverse_model import equations
from etcfit.rig.reader import read_folder

PUBLISHED = (("dynoNet", 2.64), ("CT-SUBNET", 4.61), ("NARX", 5.17), ("linear", 5.53))  # mm
AIM = 2.6  # mm
_SKIPPED = 20  # samples
_PERIOD = 6240  # samples, of the reference
_HALF = 2 * _PERIOD
_CRUISE = 0.1246  # m/s, the fastest of the reference's speeds

ALIKE: tuple[str, ...] = ()
APART = ("asymmetric_friction",)
DRIFTING = (*APART, "channel_drift[response.torque]")


def rms(measured: np.ndarray, simulated: np.ndarray) -> float:
    """Of what is left from sample 20 on, mm."""
    return 1e3 * float(np.sqrt(np.mean((measured - simulated)[_SKIPPED:] ** 2)))


def part(trace: Measurement, begin: int, end: int | None) -> Measurement:
    """Samples begin to end of a trace as a trace of its own."""
    rows, start = slice(begin, end), trace.time[begin]

    def cut(channel: Channel) -> Channel:
        return replace(channel, time=channel.time[rows] - start, value=channel.value[rows])

    channels = {name: cut(channel) for name, channel in trace.channels.items()}
    file = f"{trace.file} from {start:.4g} s"
    return replace(trace, file=file, time=trace.time[rows] - start, channels=channels)


def fitted(
    rig: Rig, effects: Sequence[str], to: Measurement, held_out: Measurement, known: Mapping[str, float] | None = None
) -> FitResult:
    """Eqs. 1-2 with effects fitted to one trace, the other simulated only; what is known (SI by symbol) stays.

    T_a is a shift of the offset T_PL and nothing else, so it stays 0.
    """
    held = {symbol: Fixed(value) for symbol, value in (known or {}).items()}
    parameters = {**rig.config.parameters, **held, **({"T_a": Fixed(0.0)} if effects else {})}
    config = replace(rig.config, effects=tuple(effects), parameters=parameters, holdout=(held_out.file,))
    traces = (replace(to, held_out=False), replace(held_out, held_out=True))
    return fit(replace(rig, config=config, measurements=traces, findings=()))


def errors(result: FitResult) -> tuple[float, float]:
    """Of the trace fitted and the one held out, free-running, mm rms."""
    first, second = (rms(m.channels["position"].value, result.predicted[m.file][:, 0]) for m in result.rig.measurements)
    return first, second


def protocol(results: dict[str, FitResult], training: Measurement, pulses: Measurement) -> RenderableType:
    """Ours beside the published ones, the best first."""
    tape = rms(*(m.channels["position"].value for m in (pulses, training)))
    ours = {f"etcfit, {name}": errors(result) for name, result in results.items()}
    rows = [(name, "", error) for name, error in PUBLISHED] + [(n, f"{e[0]:.2f}", e[1]) for n, e in ours.items()]
    rows.append(("the training record's positions, whatever the force", "", tape))
    heads, texts = ("model", "training, mm", "pulses, mm"), []
    for name, training_error, error in sorted(rows, key=lambda row: row[2]):
        texts.append((name, training_error, f"{error:.2f}"))
    return PlainTable(of_texts("", heads, texts, 1))


def told_apart(results: dict[tuple[str, str], FitResult]) -> RenderableType:
    """One model, each time fitted to another part of the data."""
    heads, texts = ("fitted to", "free run there, mm", "free run of", "mm", "B_L", "B_a", "T_f"), []
    for (to, other), result in results.items():
        own, held_out = errors(result)
        values = (f"{result.values[s]:.2f}" for s in ("B_L", "B_a", "T_f"))
        texts.append((to, f"{own:.2f}", other, f"{held_out:.2f}", *values))
    return PlainTable(of_texts("", heads, texts, 1))


def cruises(training: Measurement, pulses: Measurement) -> RenderableType:
    """Force at full speed, by period: the mean of both strokes is an offset, their half difference friction."""
    periods = [f"{k * _PERIOD * 1e-3:.1f} s" for k in range(4)]
    heads, texts = ("record", "of opening and closing", *periods), []
    for name, trace in (("training", training), ("pulses, looked at", pulses)):
        speed, force = np.gradient(trace.channels["position"].value, trace.time), trace.channels["torque"].value
        fast = np.abs(np.abs(speed) - _CRUISE) < 0.02 * _CRUISE
        which = np.arange(force.size) // _PERIOD
        up, down = ([force[fast & (which == k) & (np.sign(speed) == way)].mean() for k in range(4)] for way in (1, -1))
        for what, values in (("mean, N", np.add(up, down)), ("half difference, N", np.subtract(up, down))):
            texts.append((name, what, *(f"{0.5 * v:.2f}" for v in values)))
    return PlainTable(of_texts("", heads, texts, 2))


def sessions(training: Measurement, pulses: Measurement) -> RenderableType:
    """The inverse model of each record, and the gain of its drive: the servo's law against the drive as logged."""
    columns = ("mass, kg", "viscous, opening", "closing, N s/m", "dry, N", "offset, N", "gain of the drive")
    heads, texts = ("record", *columns), []
    for name, trace, gain in zip(("training", "pulses, looked at"), (training, pulses), _gains(), strict=True):
        e = equations(trace, trace.channels["torque"])
        speed = e.rows[:, 1]
        system = [e.rows[:, 0], np.maximum(speed, 0.0), np.minimum(speed, 0.0), e.rows[:, 4], np.ones_like(speed)]
        found = np.linalg.lstsq(np.column_stack(system), e.right, rcond=None)[0]
        texts.append((name, *(f"{v:.2f}" for v in found), f"{gain:.4f}"))
    return PlainTable(of_texts("", heads, texts, 1))


def _gains() -> list[float]:
    """Of either record: drive = gain k_v (k_p (q_g - q) - dq_f/dt) + pulse, see `emps_loop`."""
    servo, files = records()
    gains = []
    for record in files:
        smooth = 0.5 * (record.position[1:] + record.position[:-1])
        rate = np.diff(smooth) * 1e3
        law = servo.k_v * (servo.k_p * (record.reference - record.position)[2:] - rate)
        rows = np.column_stack((law, record.pulses[2:], np.ones_like(law)))
        gains.append(float(np.linalg.lstsq(rows, record.drive[2:], rcond=None)[0][0]))
    return gains


def costs(result: FitResult) -> RenderableType:
    """By how much the free run of the pulses moves with what a model believes of the force."""
    heads, texts = ("change of the model", "moves the free run of the pulses by, mm rms"), []
    values = dict(result.values)
    friction = {s: 1.01 * values[s] for s in ("B_L", "B_a", "T_f") if s in values}
    changes = {"offset + 0.1 N": {"T_PL": values["T_PL"] + 0.1}, "friction + 1 %": friction,
               "mass + 1 %": {"J_L": 1.01 * values["J_L"]}}  # fmt: skip
    as_it_is = _pulses(result, {})
    for name, change in changes.items():
        texts.append((name, f"{rms(as_it_is, _pulses(result, change)):.2f}"))
    return PlainTable(of_texts("", heads, texts, 1))


def _pulses(result: FitResult, change: dict[str, float]) -> np.ndarray:
    """Simulated position of the trace held out, at other values (SI by symbol), m."""
    if result.holdout is None:
        raise ValueError("nothing was held out of this fit")
    x = result.holdout.layout.coordinates({**result.values, **change})
    return result.holdout.free_run(x)[0][:, 0]


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    use_compilation_cache()
    with TemporaryDirectory() as scratch:
        rig = read_folder(fetch("emps", Path(scratch) / "emps"))
    training, pulses = (next(m for m in rig.measurements if m.held_out is held) for held in (False, True))
    forms = {"Eqs. 1-2": ALIKE, "direction-dependent friction": APART, "and a drift of the force's zero": DRIFTING}
    results = {name: fitted(rig, effects, training, pulses) for name, effects in forms.items()}
    print(render(headed(f"Free run of the pulses, aim {AIM} mm", protocol(results, training, pulses))))
    first, second = part(training, 0, _HALF), part(training, _HALF, None)
    pairs = {("first half of the training", "its second half"): (first, second),
             ("second half of the training", "its first half"): (second, first),
             ("pulses, looked at", "training"): (pulses, training)}  # fmt: skip
    apart = results["direction-dependent friction"]
    parts = {("training", "pulses"): apart} | {names: fitted(rig, APART, *pair) for names, pair in pairs.items()}
    drifting = results["and a drift of the force's zero"]
    zero = ("T_PL", "drift.response.torque")
    friction = {s: drifting.values[s] for s in drifting.free_parameters.layout.free if s not in zero}
    parts["pulses, zero and drift alone", "training"] = fitted(rig, DRIFTING, pulses, training, friction)
    print(render(headed("Eqs. 1-2 with direction-dependent friction, told by other parts", told_apart(parts))))
    print(render(headed("Force at full speed", cruises(training, pulses))))
    print(render(headed("What each session was like, by the inverse model", sessions(training, pulses))))
    print(render(headed("What an error of the model costs", costs(apart))))


if __name__ == "__main__":
    main()
