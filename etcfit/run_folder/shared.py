"""Keys that many JSON files of a run folder have."""

from __future__ import annotations

import platform
from importlib import metadata
from typing import TYPE_CHECKING

from .. import __version__
from .declared import Record, key

if TYPE_CHECKING:
    from ..estimation.fitted_model import Fitted
    from ..estimation.result import FitResult


def effects_of(result: FitResult | Fitted) -> list[str]:
    """Names of all effects of a model, those of Eqs. 1-2 among them."""
    return [effect.name for effect in result.free_parameters.layout.types]


def versions() -> dict[str, str]:
    """Of etcfit, Python and the numerical libraries."""
    ours = {"etcfit": __version__, "python": platform.python_version()}
    return ours | {name: metadata.version(name) for name in ("jax", "optimistix", "numpy", "scipy")}


SYMBOL = {"pattern": "^[A-Za-z][A-Za-z0-9_.]*$"}
RIG = key("text", "Name of the rig, from rig.toml.", "rig.config.name")
SYNTHETIC = key("flag", "The data came from a simulation.", "rig.config.synthetic")
VERSIONS = key("{text}", "Versions of etcfit, Python and the numerical libraries that made this file.",
    lambda _: versions())  # fmt: skip
CONVERGED = key("flag", "Whether the end is an optimum. False also means exit status 3.")
REASON = key("text", "Why (not), in words.")
WARNINGS = key("[text]", "What a reader must know, one sentence each.")
FOLDER = key("text", "The measurement folder as it was given.", "rig.folder")
FILES = key("{text?}", "SHA-256 of every measurement file that was read, by its path in the measurement folder; null "
    "for one that was gone by then.", "rig.digests", each={"pattern": "^[0-9a-f]{64}$"})  # fmt: skip
MODEL = Record(
    effects=key("[text]", "Names of all its effects, those of Eqs. 1-2 among them (see the catalogue of effects).",
        effects_of),
)  # fmt: skip
FIT_STATE = Record(
    chi2_per_dof=key("number?", "Of its residual, per degree of freedom; 1 where only noise is left."),
    converged=key("flag", "Whether it is at an optimum."),
    reason=key("text", "In words why (not)."),
    compromise=key("text?", "Why its parameters are no estimates; null where they are. Else errors and draws are as "
        "wide as the ranges that subsets of the data give, and a share of draws is no probability."),
)  # fmt: skip
