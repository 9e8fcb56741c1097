"""Loops around bodies made by hand, for the tests of what closes and judges them."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodies import OPEN, N, values
from etcfit.control.pid import Gains
from etcfit.control.pid.loop import Body, Loop
from etcfit.model.ecu import Ecu
from etcfit.model.effects import PAPER, AbstractEffect
from etcfit.model.linear import TransferFunction
from etcfit.model.parameters import parameters_of
from etcfit.model.throttle import Throttle

WIDE = Body(N, -100.0, 100.0)
QUARTER_TURN = Body(N, 0.0, OPEN)


def loop(
    *types: type[AbstractEffect], ecu: Ecu, body: Body = QUARTER_TURN, draws: Any = None, **changes: float
) -> Loop:
    """Eqs. 1-2 and further effects under an ECU; `draws` gives further values of some symbols, shape (D - 1,) each."""
    nominal = {p.symbol: p.nominal for t in types for p in parameters_of(t)} | values(**changes)
    draws = draws or {}
    count = 1 + max((len(v) for v in draws.values()), default=0)
    rows = {s: np.concatenate(([v], draws.get(s, np.full(count - 1, v)))) for s, v in nominal.items()}
    return Loop(Throttle.build((*PAPER, *types), rows), body, ecu)


def plant(of: Loop) -> TransferFunction:
    """The nominal linear plant."""
    rows = of.linear()
    return TransferFunction(*(float(np.asarray(v).flat[0]) for v in (rows.b0, rows.a2, rows.a1, rows.a0, rows.delay,
                                                                    rows.lag)))  # fmt: skip


def one(*gains: float) -> Gains:
    """Gains of shape (1,)."""
    return Gains.stacked(Gains(*gains))
