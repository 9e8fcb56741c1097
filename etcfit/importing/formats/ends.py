"""Channels that should end together and do not: what a file looks like that was cut off or damaged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

ANOTHER_RATE = 0.5  # of the longest channel's values: fewer are another rate, not an end that is missing


class Ends(NamedTuple):
    """Where channels end that were recorded together.

    Args:
        kept: rows of each that all of its group have.
        missing: what the others lack, each in a sentence.
    """

    kept: list[int]
    missing: tuple[str, ...]


def common_ends(names: Sequence[str], found: Sequence[int], said: Sequence[int]) -> Ends:
    """Channels of which the file says the same number of values belong together; so do those of about one length.

    Args:
        names: of the channels.
        found: values of each.
        said: values that the file itself says each has; 0 where it says nothing.
    """
    longest = max((n for n, each in zip(found, said, strict=True) if not each), default=0)
    keys = [(each, each or (0 if n >= ANOTHER_RATE * longest else n)) for n, each in zip(found, said, strict=True)]
    groups = {key: [k for k, each in enumerate(keys) if each == key] for key in keys}
    missing = (_lacking(names, found, said, group) for group in groups.values())
    return Ends([min(found[k] for k in groups[key]) for key in keys], tuple(filter(None, missing)))


def _lacking(names: Sequence[str], found: Sequence[int], said: Sequence[int], group: Sequence[int]) -> str:
    """What these channels lack; "" where nothing."""
    short, full = (pick(group, key=lambda k: found[k]) for pick in (min, max))
    if found[short] < said[short]:
        return f"rows are missing: it says that '{names[short]}' has {said[short]} values, and holds {found[short]}"
    if found[short] < found[full]:
        return f"rows are missing: '{names[full]}' has {found[full]} values, '{names[short]}' has {found[short]}"
    return ""
