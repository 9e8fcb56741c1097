"""How long a log takes to be read: the fast reader of plain tables beside the careful one.

python -m benchmarks.read_csv [--rows 1000000]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from etcfit.rig.table import decode, parse_plain, parse_with_care

HEADER = "time [s],voltage [V],current [A],position [deg],supply [V],temperature [degC]"


def written(rows: int) -> bytes:
    """A log of six columns, every number of another length."""
    rng = np.random.default_rng(0)
    time = 1e-3 * np.arange(rows)
    channels = [scale * rng.standard_normal(rows) for scale in (6.0, 1.8, 45.0, 12.0, 25.0)]
    lines = "\n".join(",".join(map(repr, row)) for row in np.round(np.column_stack([time, *channels]), 6).tolist())
    return f"{HEADER}\n{lines}\n".encode()


def seconds(work: Callable[..., Any], *given: Any) -> tuple[float, Any]:
    """How long it takes, and what comes of it."""
    before = time.perf_counter()
    made = work(*given)
    return time.perf_counter() - before, made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    raw = written(parser.parse_args().rows)
    decoding, text = seconds(decode, raw, "log.csv")
    importing, _ = seconds(__import__, "pandas")
    fast, table = seconds(parse_plain, text, "log.csv")
    careful, other = seconds(parse_with_care, text, "log.csv")
    assert table is not None
    assert np.array_equal(table.cells, other.cells)
    rows, columns = table.cells.shape
    print(f"{rows} rows, {columns} columns, {len(raw) / 1e6:.0f} MB")
    print(f"bytes to text {decoding:.2f} s, import of pandas {importing:.2f} s")
    print(f"fast {fast:.2f} s, careful {careful:.2f} s, ratio fast/careful {fast / careful:.3f}")


if __name__ == "__main__":
    main()
