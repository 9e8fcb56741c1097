"""A guide at the terminals draws the simulated plate along the measured angle; let go step by step, it leads to the
best free run.

    V_guide = stiffness (theta_measured - theta)

Far from the data a free run leaves the measured path at the first stick or impact that it misses, and its chi2 is full
of valleys. Under a stiff guide it cannot leave it, and there is one; each weaker guide has its valley where the
stronger one had it, a little deeper.

Source: Abarbanel et al. 2009 (synchronisation by a coupling); Vyasarayani, Uchida and McPhee 2012, Phys. Rev. E 85
(single shooting with a coupling that is taken away step by step). Differs from source: the coupling acts at the
terminals, each channel is weighed anew by the error left in it, and the coupling's first stiffness is physical.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..problem import weights
from ..problem.problem import EstimationProblem
from .levenberg_marquardt import minimise
from .settings import FitSettings, GuideSettings


class Guided(NamedTuple):
    """The measured angle along which a plate is drawn.

    Args:
        span: largest travel within a trace, rad.
        rate: samples a second, Hz.
        torque_driven: the guide acts as a torque, not as a voltage.
    """

    span: float
    rate: float
    torque_driven: bool


def guide_stiffness_of(problem: EstimationProblem, x: np.ndarray, settings: GuideSettings) -> float:
    """Stiffness of the guide for these traces; 0 where no angle was logged. Arguments and units: `guide_stiffness`."""
    guided = [t for t in problem.batch.traces if "position" in t.channels]
    if not guided:
        return 0.0
    angles = [t.data[:, t.channels.index("position")] for t in guided]
    record = Guided(
        span=max(float(np.nanmax(a) - np.nanmin(a)) for a in angles),
        rate=1.0 / float(np.median(np.concatenate([np.diff(t.instants) for t in guided]))),
        torque_driven=all(t.torque_driven for t in guided),
    )
    values = problem.layout.values(x, problem.free_parameters.held)
    return guide_stiffness(values, problem.config.gear_ratio, record, settings)


def guide_stiffness(values: Mapping[str, Any], gear: float, record: Guided, settings: GuideSettings) -> float:
    """Stiffness with which a guide draws the plate along its measured angle.

        torque = max(T_f / (0.01 span), 0.003 J w^2),    w = 2 pi min(15 Hz, rate / 10),    J = N^2 J_m + J_L
        volts  = min(torque R_a / (N K_m), 0.3 N K_b R_a / L_a)

    Beyond the last bound guide and coil would swing. The numbers are `give`, `least`, `bandwidth`, `bandwidth_of_rate`
    and `stable`.

    Args:
        values: parameters, SI by symbol.
        gear: N.
        record: of the measured angle.
        settings: what decides.
    Returns:
        V/rad, or N m/rad where torque drives.
    """
    inertia = gear**2 * float(values["J_m"]) + float(values["J_L"])
    hertz = min(settings.bandwidth, settings.bandwidth_of_rate * record.rate)
    stiff = inertia * (2.0 * np.pi * hertz) ** 2
    torque = max(float(values["T_f"]) / max(settings.give * record.span, 1e-9), settings.least * stiff)
    if record.torque_driven:
        return torque
    R_a = float(values["R_a"])
    fastest = gear * float(values["K_b"]) * R_a / float(values["L_a"])  # V/rad
    return min(torque * R_a / (gear * float(values["K_m"])), settings.stable * fastest)


def let_go(problem: EstimationProblem, x: np.ndarray, settings: FitSettings = FitSettings()) -> np.ndarray:
    """Where the guide leads that is let go step by step, if that free run is likelier than the one of x; else x itself.

    Args:
        problem: the traces, guided or not.
        x: coordinates, shape (P,).
        settings: shares of the guide's stiffness one after the other, tolerance and budget of each descent.
    """
    stiffness, here = guide_stiffness_of(problem, x, settings.guide), x
    if stiffness == 0.0:
        return x
    for share in (*settings.guide.shares, 0.0):
        guided = weights.discounted(problem.guided(share * stiffness), here)
        weighted = guided.weighted(weights.free_running(guided))
        here, _ = minimise(guided, here, weighted, settings.tolerance, settings.steps)
    return here if unlikely(problem, here) < unlikely(problem, x) else x


def unlikely(problem: EstimationProblem, x: np.ndarray) -> float:
    """-log likelihood of the free run, each channel of each trace with the error that is left in it.

    sum of (y - y_hat)^2 / 2 sigma^2 + log sigma,    sigma as of `weights.discounted`
    """
    free = weights.discounted(problem.guided(0.0), x)
    chi2 = free.chi2(x, free.weighted(weights.free_running(free)))
    slots = problem.batch.slots
    return 0.5 * chi2 + float(np.sum(np.log(free.sigma / slots.sigma)[slots.weight > 0.0]))
