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
from .manifest import POSTERIOR, replacing
from .posterior import posterior_json, write_netcdf
from .reduction import reduction_json

_RESPONSE = "frequency_response.json"


def nothing_beside(run: Path) -> None:
    """No pictures."""


def save_posterior(
    run: Path,
    posterior: Posterior,
    profiles: Mapping[str, Profile],
    bands: Sequence[Band],
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[Path], None] = nothing_beside,
) -> None:
    """RUN/posterior.nc and RUN/posterior.json; `beside` draws into a folder that stands for RUN until all is there."""
    with replacing(run, "sample", exit, settings) as draft:
        write_netcdf(draft / POSTERIOR, posterior)
        write_json(draft / "posterior.json", "posterior", posterior_json(posterior, profiles, bands))
        beside(draft)


def save_reduction(
    run: Path,
    fitted: Fitted,
    reduction: Reduction,
    response: FrequencyResponse | None,
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[Path], None] = nothing_beside,
) -> None:
    """RUN/transfer_function.json, and what sine traces say beside it: RUN/frequency_response.json.

    Args:
        run: the run folder.
        fitted, reduction: the model and its linear plant.
        response: of the sine traces; None where the rig has none.
        exit, settings: of the stage; `pade_order` among the settings, see `reduction_json`.
        beside: draws into a folder that stands for RUN until all is there.
    """
    with replacing(run, "reduce", exit, settings) as draft:
        plant = reduction_json(fitted, reduction, int(settings.get("pade_order", 0)))
        write_json(draft / "transfer_function.json", "transfer_function", plant)
        if response is not None:
            write_json(draft / _RESPONSE, "frequency_response", frequency_json(fitted, response))
        beside(draft)


def save_design(
    run: Path,
    design: Design,
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[Path], None] = nothing_beside,
    outside: Sequence[Path] = (),
) -> None:
    """RUN/pid.json; `beside` draws into a folder that stands for RUN until all is there. `outside`: files besides RUN's
    that it was made from."""
    with replacing(run, "design", exit, settings, outside=outside) as draft:
        write_json(draft / "pid.json", "pid", design_json(design))
        beside(draft)
