"""Channels of single traces: where a mistake of one channel in one file could be told from one of a whole test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from .base import DRIVING, OBSERVED, Logged, Place

_SIGNALS = frozenset({*OBSERVED, *DRIVING})


def channels_of_traces(
    traces: Logged, channels: Iterable[str], places: Callable[[Logged], tuple[Place, ...]]
) -> tuple[Place, ...]:
    """Places of channels in single traces.

    A trace must have logged another signal beside the channel, and another trace, of whatever test, that channel too.
    A test of one trace has none where the test itself is a place: both would be the same, and the test is simpler.

    Args:
        traces: what each file logged.
        channels: those that are meant.
        places: of whole tests, by what each of them logged.
    """
    tests = places(_by_test(traces))
    logged = Counter(channel for seen in traces.values() for channel in seen)
    files = Counter(Place.named(file).test for file in traces)
    found = []
    for file, seen in traces.items():
        place = Place.named(file)
        told = [c for c in channels if c in seen and logged[c] > 1 and len(seen & _SIGNALS) > 1]
        found += [place._replace(channel=c) for c in told if files[place.test] > 1 or Place(place.test, c) not in tests]
    return tuple(found)


def _by_test(traces: Logged) -> dict[str, frozenset[str]]:
    found: dict[str, frozenset[str]] = {}
    for file, channels in traces.items():
        test = Place.named(file).test
        found[test] = found.get(test, frozenset()) | channels
    return found
