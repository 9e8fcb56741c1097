"""What the stages after the models leave in RUN: posterior, linear plant, gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import Reduction
from ..estimation.fitted_model import Fitted
from ..files import write_json
from ..posterior.predictive import Band
from ..posterior.profile import Profile
from ..posterior.sampling import Posterior
from .design import design_json
from .frequency import frequency_json
from .manifest import POSTERIOR, begin, finish
from .posterior import posterior_json, write_netcdf
from .reduction import reduction_json

_RESPONSE = "frequency_response.json"


def nothing_beside() -> None:
    """No pictures."""


def save_posterior(
    run: Path,
    posterior: Posterior,
    profiles: Mapping[str, Profile],
    bands: Sequence[Band],
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[], None] = nothing_beside,
) -> None:
    """RUN/posterior.nc and RUN/posterior.json; `beside` draws before the stage counts as done."""
    begin(run, "sample")
    write_netcdf(run / POSTERIOR, posterior)
    write_json(run / "posterior.json", "posterior", posterior_json(posterior, profiles, bands))
    beside()
    finish(run, "sample", exit, settings)


def save_reduction(
    run: Path,
    fitted: Fitted,
    reduction: Reduction,
    response: FrequencyResponse | None,
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[], None] = nothing_beside,
) -> None:
    """RUN/transfer_function.json, and what sine traces say beside it: RUN/frequency_response.json.

    Args:
        run: the run folder.
        fitted, reduction: the model and its linear plant.
        response: of the sine traces; None where the rig has none.
        exit, settings: of the stage; `pade_order` among the settings, see `reduction_json`.
        beside: draws before the stage counts as done.
    """
    begin(run, "reduce")
    (run / _RESPONSE).unlink(missing_ok=True)
    plant = reduction_json(fitted, reduction, int(settings.get("pade_order", 0)))
    write_json(run / "transfer_function.json", "transfer_function", plant)
    if response is not None:
        write_json(run / _RESPONSE, "frequency_response", frequency_json(fitted, response))
    beside()
    finish(run, "reduce", exit, settings)


def save_design(
    run: Path,
    design: Design,
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[], None] = nothing_beside,
    outside: Sequence[Path] = (),
) -> None:
    """RUN/pid.json; `beside` draws before the stage counts as done. `outside`: files besides RUN's that it was made
    from."""
    begin(run, "design")
    write_json(run / "pid.json", "pid", design_json(design))
    beside()
    finish(run, "design", exit, settings, outside=outside)
