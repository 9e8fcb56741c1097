"""Public measured data sets as measurement folders: one file each, registered here and nowhere else."""

from __future__ import annotations

from pathlib import Path

from ..errors import UsageError
from .bam_xl330 import BAM_XL330
from .base import Dataset, Source, obtain, refuse_to_overwrite, write_folder
from .emps import EMPS
from .kassel_throttle import KASSEL_THROTTLE
from .wintec_throttle import WINTEC_THROTTLE

DATASETS: dict[str, Dataset] = {
    dataset.name: dataset for dataset in (KASSEL_THROTTLE, WINTEC_THROTTLE, EMPS, BAM_XL330)
}

__all__ = ["DATASETS", "Dataset", "Source", "fetch"]


def fetch(name: str, to: Path, data: Path | None = None) -> Path:
    """A public data set as a measurement folder, which must not exist or be empty; arguments as of `etcfit.fetch`.

    Raises:
        UsageError: no data set has this name, or `to` holds something already.
        MeasurementError: a file is not the published one, or cannot be had.
    """
    if name not in DATASETS:
        raise UsageError(f"No data set is called {name!r}. There are: {', '.join(DATASETS)}.")
    refuse_to_overwrite(to)  # before a download, not after it
    dataset = DATASETS[name]
    files = {source.local: obtain(source, data) for source in dataset.sources}
    return write_folder(to, dataset.convert(files))
