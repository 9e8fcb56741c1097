"""The paper's values of its own throttle body, made by Bosch: Table 2, SI.

J_m, J_L and J_eq contradict each other: N^2 J_m + J_L is 0.0440 kg m2, not the printed 0.0012, which the release traces
show. The other values are consistent.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

TABLE_2: Mapping[str, float] = MappingProxyType({
    "R_a": 1.513, "L_a": 1.475e-3, "K_b": 0.0189, "K_m": 0.0189, "J_m": 1e-4, "J_L": 0.0012, "B_m": 2e-5, "B_L": 0.0,
    "K_s": 0.150, "T_PL": 0.362, "T_f": 0.239, "N": 20.68, "J_eq": 0.0012, "B_eq": 0.0085,
})  # fmt: skip
