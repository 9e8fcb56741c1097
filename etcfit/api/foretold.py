"""A log after new gains beside what `etcfit tune` foretold for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..car_log import Study
from ..car_log.foretold import held_against
from ..errors import UsageError
from ..reporting.car_log.foretold import Held
from ..run_folder.reading import read_foretold


def one_held_against(studies: Sequence[Study], run: Path, made_with: str | None) -> Held:
    """The one log that there is, beside what a run foretold.

    Args:
        studies: of it alone.
        run: of `etcfit tune`.
        made_with: whose gains made it, as tune.json or the command line names them; half way where None.
    Raises:
        UsageError: several logs, or a run that foretells nothing.
        MeasurementError: no such steps in it.
    """
    if len(studies) != 1:
        raise UsageError(f"--foretold is about one log, and there are {', '.join(each.log.name for each in studies)}. "
                         "Name the file of the one that the new gains made.")  # fmt: skip
    told, name, content = read_foretold(run, made_with and made_with.replace("-", "_"))
    return Held(studies[0].log.name, run, name, content, held_against(studies[0], told))
