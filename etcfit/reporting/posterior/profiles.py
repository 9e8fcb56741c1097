"""Profile likelihoods, a panel a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...posterior.profile import RISE, Profile
from .. import style

_ACROSS = 3


def draw(rig: str, profiles: Sequence[Profile], units: Mapping[str, str], synthetic: bool) -> Figure:
    """chi2's rise over its least as one parameter is held and the others follow."""
    across = min(_ACROSS, len(profiles))
    down = -(-len(profiles) // across)
    tall = 0.7 + 2.9 * down
    fig = style.figure(max(5.0, 4.2 * across), tall, synthetic)
    grid = fig.subplots(down, across, squeeze=False)
    for panel, profile in zip(grid.flat, profiles, strict=False):
        _panel(panel, profile, units[profile.symbol])
    for panel in grid.flat[len(profiles) :]:
        panel.set_visible(False)
    fig.suptitle(f"{rig}  ·  profile likelihood", x=0.015, y=1.0 - 0.08 / tall, ha="left", va="top", fontsize=13)
    fig.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.4 / tall))
    return fig


def _panel(panel: Axes, profile: Profile, unit: str) -> None:
    panel.plot(profile.value, profile.rise, "o-", color=style.READING, ms=4)
    panel.axhline(RISE, color=style.SIMULATED, ls="--", lw=1.2)
    for end in (profile.low, profile.high):
        if end is not None:
            panel.axvline(end, color=style.SIMULATED, lw=1.0)
    panel.set_ylim(-0.3, min(3.0 * RISE, max(1.5 * RISE, 1.1 * float(np.max(profile.rise)))))
    panel.set_xlabel(f"{profile.symbol} [{unit}]")
    panel.set_ylabel("rise of chi2 [1]")
    panel.set_title(f"{profile.symbol}: {profile.kind}", loc="left")
