"""All pictures of a posterior, in the order of interest."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from ...posterior import Posterior
from ...posterior.profile import Profile

Job = tuple[Path, Callable[[], Figure]]


def jobs(posterior: Posterior, profiles: Mapping[str, Profile]) -> list[Job]:
    """Every picture: path below RUN/pictures/posterior, and the call that draws it."""
    return []
