"""Makes the committed folder: `python -m independent.bench_twin measurements/bench_twin`."""

from __future__ import annotations

import sys
from pathlib import Path

from .effects import Effects, LimpHomeSpring
from .folder import SIZES, write_folder
from .instruments import Bench
from .truth import Truth

SEED = 280750148
TRUTH = Truth(
    R_a=1.637,
    L_a=1.382e-3,
    K_b=0.01763,
    K_m=0.01763,
    J_m=1.57e-6,
    J_L=5.3e-4,
    B_m=2.21e-5,
    B_L=1.17e-3,
    K_s=0.1682,
    T_PL=0.3413,
    T_f=0.2137,
)
UNDECLARED = Effects(limp_home_spring=LimpHomeSpring(angle=0.1571, stiffness=0.87, preload=0.316, corner=0.009))


def main(path: Path) -> None:
    """Write the folder, without its truth."""
    name = "bench twin (synthetic throttle body)"
    write_folder(path, name, TRUTH, SEED, UNDECLARED, SIZES["twin"], Bench(), holdout=True, noise=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
