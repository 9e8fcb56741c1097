"""A folder with a mistake in it is refused, by a message that carries its cure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.reader import read_folder
from folders import changed


def assert_refused(path: Path, changes: Mapping[str, str | bytes], message: str) -> None:
    """Reading the good folder with these changes ends in a message like this one, whole and naming the file."""
    with pytest.raises(MeasurementError) as caught:
        read_folder(changed(path, changes))
    error = caught.value
    assert re.search(message, str(error), re.DOTALL), str(error)
    assert error.where.startswith(str(path))
    assert all((error.found, error.required, error.mend))
