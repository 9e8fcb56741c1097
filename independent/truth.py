"""The throttle body behind a synthetic folder: Eqs. 1-2's parameters, in SI, with the paper's symbols."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

OPEN = float(np.pi / 2)  # rad, the upper stop
RETURN_MARGIN = 0.03  # N m by which the preload beats dry friction; below it an open plate would stay open


@dataclass(frozen=True)
class Truth:
    """L_a di/dt + R_a i + N K_b w = v ;  J_eq dw/dt + B_eq w + K_s th + T_PL + T_f sgn w = N K_m i.

    Source: the paper's Eqs. 1-2 at the plate. Differs from source: sgn is set-valued at rest; B_L is not neglected.
    """

    # R_a, L_a: armature, ohm and H
    R_a: float = 1.513
    L_a: float = 1.475e-3
    # K_b, K_m: V s/rad and N m/A, at the motor
    K_b: float = 0.0189
    K_m: float = 0.0189
    # J_m, J_L: inertia of motor and plate, kg m^2, each on its own shaft
    J_m: float = 1.0e-4
    J_L: float = 1.2e-3
    # B_m, B_L: viscous damping of motor and plate, N m s/rad, each on its own shaft
    B_m: float = 2.0e-5
    B_L: float = 1.0e-3
    # K_s, T_PL, T_f: spring N m/rad, preload N m, dry friction N m, at the plate
    K_s: float = 0.150
    T_PL: float = 0.362
    T_f: float = 0.239
    N: float = 20.68  # gear ratio

    @property
    def J_eq(self) -> float:
        """N^2 J_m + J_L, kg m^2 at the plate."""
        return self.N**2 * self.J_m + self.J_L

    @property
    def B_eq(self) -> float:
        """N^2 B_m + B_L, N m s/rad at the plate."""
        return self.N**2 * self.B_m + self.B_L

    def volts_for(self, torque: float) -> float:
        """Steady voltage whose motor torque is this one at the plate: R_a T / (N K_m), V."""
        return self.R_a * torque / (self.N * self.K_m)


TABLE_2 = Truth()  # Table 2 to the letter: N^2 J_m alone is 36 times the paper's own J_eq
CONSISTENT = replace(TABLE_2, J_m=1.4e-6, J_L=6.0e-4)  # J_eq = 0.0012, which the paper's two release traces show


def draw_truth(rng: np.random.Generator, centre: Truth = CONSISTENT, spread: float = 0.4) -> Truth:
    """Each parameter uniform within +-spread of the centre, K_m = K_b, N kept; drawn again until the plate returns."""
    while True:
        drawn = {
            name: value * rng.uniform(1 - spread, 1 + spread)
            for name, value in asdict(centre).items()
            if name not in ("K_m", "N")
        }
        truth = replace(centre, **drawn, K_m=drawn["K_b"])
        if truth.T_PL - truth.T_f > RETURN_MARGIN:
            return truth
