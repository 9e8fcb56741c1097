"""What each rig test and each trace does to each parameter: where the fit would go without it, in one step.

    pull = (x_without - x) / sd,    x_without - x = -(F - F_g)^-1 (s - s_g) + F^-1 s

F, s and sd are those of all data, F_g and s_g those of the part left out, see `statement`; sd is what noise alone
leaves, not widened. Exact where the model is linear. A parameter that the rest does not determine has no pull: `alone`
names it.

Source: Belsley, Kuh and Welsch 1980, Regression Diagnostics, eq. 2.1 (DFBETAS). Differs from source: rows are left out
by trace and by test, and sd is that of all data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add

import numpy as np

from .statement import Split, Statement


@dataclass(frozen=True)
class Pull:
    """What leaving a part of the data out moves.

    Args:
        test: the rig test left out, or of the file left out.
        file: the one left out; None for the whole test.
        parameter: symbol.
        pull: by how much, standard errors of noise alone.
        moved: the same in the coordinate.
    """

    test: str
    file: str | None
    parameter: str
    pull: float
    moved: float


@dataclass(frozen=True)
class Influence:
    """Who determines what.

    Args:
        pulls: every part of the data on every parameter that the others determine as well; the largest first.
        alone: parameters that one rig test, or one file, determines alone: symbol to its name.
    """

    pulls: tuple[Pull, ...] = ()
    alone: Mapping[str, str] = field(default_factory=dict)

    def largest(self, least: float, most: int) -> tuple[Pull, ...]:
        """The first ones.

        Args:
            least: standard errors that a pull must have.
            most: how many.
        """
        return tuple(pull for pull in self.pulls[:most] if abs(pull.pull) >= least)


def influence(
    symbols: Sequence[str],
    traces: Mapping[tuple[str, str], Statement],
    believed: Statement,
    reach: np.ndarray,
    unknown: float,
) -> Influence:
    """Leave out every test and, where it has more than one, every trace of it.

    Args:
        symbols: free parameters, P.
        traces: what each trace says, by test and file.
        believed: the priors.
        reach: of each coordinate, shape (P,).
        unknown: standard deviation above which a parameter is not known, reaches.
    """
    everything = reduce(add, traces.values(), believed)
    sd = np.sqrt(np.diag(np.linalg.inv(everything.information)))
    known = sd < unknown * reach
    pulls, alone = [], {}
    for (test, file), own in parts(traces).items():
        split = Split(own, everything - own, reach, unknown)
        lost = split.lost_without
        alone = {s: file or test for s, gone, k in zip(symbols, lost, known, strict=True) if gone and k} | alone
        rows = zip(symbols, split.shift.tolist(), sd.tolist(), known & ~lost, strict=True)
        pulls += [Pull(test, file, s, moved / sigma, moved) for s, moved, sigma, told in rows if told]
    return Influence(tuple(sorted(pulls, key=lambda each: -abs(each.pull))), alone)


def parts(traces: Mapping[tuple[str, str], Statement]) -> dict[tuple[str, str | None], Statement]:
    """What every test says, with None for its file, and every trace of a test that has several."""
    tests: dict[str, list[str]] = {}
    for test, file in traces:
        tests.setdefault(test, []).append(file)
    out: dict[tuple[str, str | None], Statement] = {}
    for test, files in tests.items():
        out[test, None] = reduce(add, (traces[test, f] for f in files))
        out |= {(test, f): traces[test, f] for f in files if len(files) > 1}
    return out
