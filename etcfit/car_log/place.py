"""What the user names: a folder of logs, or one log."""

from __future__ import annotations

from pathlib import Path

from ..rig.base import RigConfig
from ..rig.config import read_config
from .log import DriveLog
from .read import read_log, read_logs


def logs_at(place: Path | str) -> tuple[RigConfig, tuple[DriveLog, ...]]:
    """The logs of a folder (see `read_logs`), or one log; its rig.toml lies beside it, or above drive/.

    Raises:
        MeasurementError: no log, or one without position or time.
    """
    path = Path(place)
    if not path.is_file():
        return read_logs(path)
    folder = path.absolute().parent
    toml = (folder.parent if folder.name == "drive" else folder) / "rig.toml"
    config = read_config(toml) if toml.is_file() else RigConfig(name=path.stem)
    return config, (read_log(path, config, str(toml)),)
