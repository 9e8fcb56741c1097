"""Makes the committed fleet: `python -m independent.line_fleet measurements/fleet_12`."""

from __future__ import annotations

import sys
from pathlib import Path

from .fleet import FleetTruth, Limits, make_fleet
from .line import Line, Odd

SEED = 12
UNITS = 12
LINE = Line(
    batch=6,
    batch_share=0.3,
    a_day=3,
    rigs=2,
    operators=2,
    rig_gain={"current": 0.002, "tps": 0.001},
    odd=(Odd(4, "stribeck_friction"), Odd(9, "series_resistance")),
)
LIMITS = {
    "R_a": Limits(1.38, 1.74, "ohm"),
    "K_s": Limits(0.132, 0.160, "N*m/rad"),
    "T_PL": Limits(0.33, 0.405, "N*m"),
    "T_f": Limits(None, 0.26, "N*m"),
}


def main(path: Path) -> FleetTruth:
    """Write the fleet, without its truth."""
    return make_fleet(path, LINE, UNITS, SEED, name="twelve from a line (synthetic throttle bodies)", limits=LIMITS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
