"""Measurement folders for the rows of `benchmarks.speed`: `python -m benchmarks.speed.folders NAME FOLDER`.

In a process of its own, for a process is said to be at least as large as the one that started it was.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from independent import CONSISTENT, MEDIUM, NONE, Bench, combine, draw_truth, make_folder
from independent.folder import write_folder
from independent.protocols import Series

SEED = 1
LACKED = "stribeck_friction"
MISSING = {  # 26 traces, 37,000 samples
    "resistance": Series(6, 0.4, 1000),
    "inductance": Series(2, 0.02, 20_000),
    "back_emf": Series(3, 0.4, 2000),
    "static_load": Series(2, 16.0, 250, held=1),
    "viscous": Series(5, 0.8, 1000),
    "inertia": Series(3, 0.4, 2000),
    "response": Series(5, 3.4, 1000, held=1),
}
LACKED_TWO = "stribeck_friction", "limp_home_spring"
TWO = {**MISSING, "response": Series(9, 3.4, 1000, held=2)}  # 30 traces, 50,000 samples
LONG = {**MISSING, "response": Series(20, 20.0, 1000, held=1)}  # 41 traces, 420,000 samples
MANY = {  # 200 traces of 20,000 samples
    "resistance": Series(10, 20.0, 1000),
    "static_load": Series(10, 20.0, 1000, held=1),
    "viscous": Series(20, 20.0, 1000),
    "response": Series(160, 20.0, 1000, held=1),
}


def fit30(path: Path) -> None:
    """30 traces, 68,000 samples of a body that Eqs. 1-2 describe."""
    make_folder(path, draw_truth(np.random.default_rng(SEED), CONSISTENT), SEED, size="bench")


def missing(path: Path) -> None:
    """26 traces, 37,000 samples of a body with one effect that Eqs. 1-2 lack."""
    truth = draw_truth(np.random.default_rng(SEED), CONSISTENT)
    write_folder(path, LACKED, truth, SEED, MEDIUM[LACKED], MISSING, Bench(), holdout=True, noise=True)


def two(path: Path) -> None:
    """30 traces, 50,000 samples of a body with two effects that Eqs. 1-2 lack."""
    truth = draw_truth(np.random.default_rng(SEED), CONSISTENT)
    lacked = combine(*(MEDIUM[name] for name in LACKED_TWO))
    write_folder(path, "two", truth, SEED, lacked, TWO, Bench(), holdout=True, noise=True)


def long20(path: Path) -> None:
    """41 traces, 420,000 samples, most of them in 20 traces of 20 s."""
    truth = draw_truth(np.random.default_rng(SEED), CONSISTENT)
    write_folder(path, "many", truth, SEED, NONE, LONG, Bench(), holdout=True, noise=True)


def memory200(path: Path) -> None:
    """200 traces of 20,000 samples."""
    truth = draw_truth(np.random.default_rng(SEED), CONSISTENT)
    write_folder(path, "many", truth, SEED, NONE, MANY, Bench(), holdout=True, noise=True)


def public(name: str, path: Path) -> None:
    """A public data set."""
    from etcfit.datasets import fetch

    fetch(name, path)


FOLDERS: dict[str, Callable[[Path], None]] = {
    "fit30": fit30,
    "missing": missing,
    "two": two,
    "long20": long20,
    "memory200": memory200,
    "kassel-throttle": partial(public, "kassel-throttle"),
    "bam-xl330": partial(public, "bam-xl330"),
}


if __name__ == "__main__":
    FOLDERS[sys.argv[1]](Path(sys.argv[2]))
