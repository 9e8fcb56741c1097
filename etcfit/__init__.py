"""Parameters, missing physics and PID gains of an electronic throttle body, from a folder of rig measurements.

    rig = etcfit.read_folder("measurements/bench_twin")
    fit = etcfit.fit(rig)                   fit.parameters, fit.trace(file).to_frame(), fit.plot.overview()
    found = etcfit.diagnose(fit)            found.verdict, found.ledger, found.final
    etcfit.sample(found), etcfit.reduce(found), etcfit.design(found)
    found.save("runs/x");  etcfit.load("runs/x");  etcfit.report("runs/x")

The verbs are those of the command line, one to one. Names are imported when they are first used, so that `import
etcfit` costs nothing and `etcfit --help` answers at once.
"""

from __future__ import annotations

import ast
import importlib
import os
import time
from pathlib import Path
from typing import Any

__version__ = "0.2.0"
IMPORTED_AT = time.time()  # s since the epoch; a source that changed later may not be what runs in this process

# the model is stiff and the fit compares nested models: 32 bit is not enough. Read by JAX when it is first imported
os.environ.setdefault("JAX_ENABLE_X64", "1")
# XLA's log, such as its alarm about a slow compilation, is not for the terminal; what fails still is an exception
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def _declared() -> dict[str, str]:
    """Each public name with its module, by the stub that type checkers read: scientific-python.org's SPEC 1."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


MODULE_OF = _declared()
__all__ = ["__version__", *MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in MODULE_OF:
        raise AttributeError(f"module 'etcfit' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"etcfit.{MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
