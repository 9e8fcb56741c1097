"""What a black box makes of the data sets that our models are judged on: how far the data go without physics.

    ETCFIT_DATA=../shared/measured python -m benchmarks.black_box kassel-throttle bam-xl330

A neural NARX model, run free: its output is fed back, never the measured one.

    y_{k+1} = y_k + d f(y_k, (y_k - y_{k-1})/d, ..., (y_k - y_{k-n})/d, u_{k+1}, ..., u_{k+1-n})

y is the position and u what drives it, on an even grid, both scaled by what was fitted; f has two layers of tanh, d is
a usual change. It is trained (Adam, plain) on the error of free runs over windows that begin anywhere in the part that
is fitted. Lags n, width and length of the training are chosen by the free run over the last quarter of that part; then
it is trained once more on all of it. The held-out part is the one that our models are scored on, whole and from its
first samples: of each seed, and of the mean of their paths. It sets no bound: another black box may go further.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from etcfit.backend import use_compilation_cache
from etcfit.datasets import fetch
from etcfit.reporting.blocks import PlainTable, headed, render
from etcfit.reporting.table import of_texts
from etcfit.rig.base import Measurement, Rig
from etcfit.rig.reader import read_folder

# ours, run free on the held-out part: docs/validation/real_data.md
OURS = {"kassel-throttle": 35.4, "bam-xl330": 3.22}
UNITS = {"kassel-throttle": ("mV", 1e3 / 0.4040114009246133), "bam-xl330": ("deg", 180.0 / np.pi)}  # of 1 rad
PERIOD = 0.01  # s
FORMS = tuple(product((2, 4), (16, 32)))  # lags and width
SEEDS = (0, 1, 2)
CHECKS, STEPS = 6, 400  # the training is looked at so often, after so many steps each
_HORIZON, _WINDOWS = 150, 64  # samples of a window, windows of a step
_STRIDE = 0.1  # usual change of the scaled position from one sample to the next
_RATE, _LEAST_RATE = 4e-3, 2e-4  # of Adam, at the begin and at the end

Weights = list[tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Run:
    """One trace on an even grid.

    Args:
        drive, position: V (or duty) and rad, or scaled, shape (n,).
    """

    drive: np.ndarray
    position: np.ndarray

    def part(self, begin: int, end: int | None = None) -> Run:
        return Run(self.drive[begin:end], self.position[begin:end])


def run_of(trace: Measurement) -> Run:
    """Duty times supply, where one was logged; a command is held until the next."""
    duty, position = trace.channels["duty"], trace.channels["position"]
    supply = trace.channels["supply"].value if "supply" in trace.channels else 1.0
    grid = np.arange(duty.time[0], duty.time[-1], PERIOD)
    held = np.searchsorted(duty.time, grid + 1e-9, side="right") - 1
    return Run((duty.value * supply)[held], np.interp(grid, position.time, position.value))


def runs(rig: Rig, held_out: bool) -> list[Run]:
    """Of all traces with a drive."""
    return [run_of(m) for m in rig.measurements if m.held_out is held_out and "duty" in m.channels]


def born(seed: int, lags: int, width: int) -> Weights:
    """Random weights; the last layer's small, so that the position begins by standing still."""
    sizes = (2 * lags + 2, width, width, 1)
    keys = jax.random.split(jax.random.key(seed), len(sizes))
    scale = (1.0, 1.0, 0.1)
    return [(s * jax.random.normal(k, (a, b), jnp.float32) / np.float32(np.sqrt(a)), jnp.zeros(b, jnp.float32))
            for k, a, b, s in zip(keys, sizes[:-1], sizes[1:], scale, strict=False)]  # fmt: skip


def _increment(weights: Weights, x: Array) -> Array:
    for matrix, bias in weights[:-1]:
        x = jnp.tanh(x @ matrix + bias)
    matrix, bias = weights[-1]
    return (x @ matrix + bias)[..., 0]


@partial(jax.jit, static_argnums=1)
def free_run(weights: Weights, lags: int, drive: Array, position: Array) -> Array:
    """Simulated positions, shape (..., n), of which the first lags + 1 are the measured ones.

    Args:
        drive, position: shape (..., n).
    """

    def tick(past: Array, inputs: Array) -> tuple[Array, Array]:
        here = past[..., -1:]
        seen = jnp.concatenate((here, (here - past[..., :-1]) / _STRIDE, inputs), axis=-1)
        new = here[..., 0] + _STRIDE * _increment(weights, seen)
        return jnp.concatenate((past[..., 1:], new[..., None]), axis=-1), new

    length = drive.shape[-1]
    inputs = jnp.stack([drive[..., lags + 1 - k : length - k] for k in range(lags + 1)], axis=-1)
    begin = position[..., : lags + 1]
    _, path = jax.lax.scan(tick, begin, jnp.moveaxis(inputs, -2, 0))
    return jnp.concatenate((begin, jnp.moveaxis(path, 0, -1)), axis=-1)


def _loss(weights: Weights, lags: int, drive: Array, position: Array) -> Array:
    return jnp.mean((free_run(weights, lags, drive, position) - position) ** 2)


@partial(jax.jit, static_argnums=1)
def _adam(weights: Weights, lags: int, moments: tuple[Weights, Weights], k: Array, drive: Array, position: Array):
    """One step of Adam (Kingma and Ba 2015), the gradient clipped to length 1, the rate falling with a cosine."""
    slope = jax.grad(_loss)(weights, lags, drive, position)
    length = jnp.sqrt(sum(jnp.sum(s**2) for s in jax.tree.leaves(slope)))
    slope = jax.tree.map(lambda s: s / jnp.maximum(length, 1.0), slope)
    first = jax.tree.map(lambda m, s: 0.9 * m + 0.1 * s, moments[0], slope)
    second = jax.tree.map(lambda m, s: 0.999 * m + 0.001 * s**2, moments[1], slope)
    rate = _LEAST_RATE + 0.5 * (_RATE - _LEAST_RATE) * (1.0 + jnp.cos(jnp.pi * k / (CHECKS * STEPS)))
    fair1, fair2 = 1.0 - 0.9 ** (k + 1.0), 1.0 - 0.999 ** (k + 1.0)
    step = jax.tree.map(lambda m, v: rate * (m / fair1) / (jnp.sqrt(v / fair2) + 1e-8), first, second)
    return jax.tree.map(jnp.subtract, weights, step), (first, second)


def trained(seed: int, lags: int, width: int, data: Sequence[Run], checks: int = CHECKS) -> list[Weights]:
    """The weights at each check."""
    rng = np.random.default_rng(seed)
    weights = born(seed, lags, width)
    zeros = jax.tree.map(jnp.zeros_like, weights)
    moments, seen = (zeros, zeros), []
    starts = [(k, at) for k, run in enumerate(data) for at in range(run.drive.size - _HORIZON)]
    for k in range(checks * STEPS):
        chosen = [starts[j] for j in rng.integers(len(starts), size=_WINDOWS)]
        windows = [data[i].part(at, at + _HORIZON) for i, at in chosen]
        drive, position = (np.stack([getattr(w, name) for w in windows]) for name in ("drive", "position"))
        weights, moments = _adam(weights, lags, moments, jnp.float32(k), drive, position)
        if (k + 1) % STEPS == 0:
            seen.append(weights)
    return seen


def paths(weights: Weights, lags: int, data: Sequence[Run]) -> np.ndarray:
    """Simulated positions of all runs, one after the other, scaled."""
    each = [np.asarray(free_run(weights, lags, run.drive, run.position), dtype=float) for run in data]
    return np.concatenate(each)


def rms(path: np.ndarray, data: Sequence[Run]) -> float:
    """Of simulated positions of all runs, one after the other, scaled."""
    return float(np.sqrt(np.mean((path - np.concatenate([run.position for run in data])) ** 2)))


@dataclass(frozen=True)
class Scaled:
    """Runs in units in which drive and position of the fitted ones spread by 1, single precision."""

    fitted: tuple[Run, ...]
    held_out: tuple[Run, ...]
    size: float  # of a unit of position, rad


def scaled(fitted: Sequence[Run], held_out: Sequence[Run]) -> Scaled:
    every = {name: np.concatenate([getattr(run, name) for run in fitted]) for name in ("drive", "position")}
    middle, size = ({k: float(f(v)) for k, v in every.items()} for f in (np.mean, np.std))

    def of(run: Run) -> Run:
        names = ("drive", "position")
        return Run(*(((getattr(run, k) - middle[k]) / size[k]).astype(np.float32) for k in names))

    return Scaled(tuple(map(of, fitted)), tuple(map(of, held_out)), size["position"])


def chosen(data: Sequence[Run]) -> tuple[int, int, int]:
    """Lags, width and number of checks that predict the last quarter of each fitted run best, by the mean seed."""
    cuts = [3 * run.drive.size // 4 for run in data]
    early = [run.part(0, cut) for run, cut in zip(data, cuts, strict=True)]
    late = [run.part(cut) for run, cut in zip(data, cuts, strict=True)]
    scores: dict[tuple[int, int, int], float] = {}
    for lags, width in FORMS:
        seen = [[rms(paths(w, lags, late), late) for w in trained(seed, lags, width, early)] for seed in SEEDS]
        for check, score in enumerate(np.mean(np.nan_to_num(seen, nan=np.inf), axis=0), 1):
            scores[lags, width, check] = float(score)
    return min(scores, key=lambda form: scores[form])


def measure(name: str, folder: Path) -> Mapping[str, list[float]]:
    """Free-run rms of every seed and of the mean of their paths, fitted and held out, in the unit of `UNITS`."""
    begin, rig = time.perf_counter(), read_folder(fetch(name, folder / name))
    data = scaled(runs(rig, held_out=False), runs(rig, held_out=True))
    lags, width, checks = chosen(data.fitted)
    size = data.size * UNITS[name][1]
    ends = [trained(seed, lags, width, data.fitted, checks)[-1] for seed in SEEDS]
    took = time.perf_counter() - begin
    print(f"{name}: {lags} lags, width {width}, {checks * STEPS} steps, {took:.0f} s")
    found = {}
    for which, part in (("fitted", data.fitted), ("held out", data.held_out)):
        simulated = [paths(end, lags, part) for end in ends]
        found[which] = [size * rms(path, part) for path in (*simulated, np.mean(simulated, axis=0))]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=list(OURS), metavar="NAME")
    names = parser.parse_args().names
    use_compilation_cache()
    head = ("black box, fitted: each seed", "mean path", "held out: each seed", "mean path", "ours")
    heads, rows = ("data", "unit", *head), []
    with TemporaryDirectory() as scratch:
        for name in names:
            found = measure(name, Path(scratch))
            texts = [[f"{v:.3g}" for v in found[which]] for which in ("fitted", "held out")]
            cells = [cell for text in texts for cell in (", ".join(text[:-1]), text[-1])]
            rows.append((name, UNITS[name][0], *cells, f"{OURS[name]:g}"))
    print(render(headed("Free run, rms", PlainTable(of_texts("", heads, rows, 2)))))


if __name__ == "__main__":
    main()
