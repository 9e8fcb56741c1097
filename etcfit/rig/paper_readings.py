"""Reads the graphs of all rig tests one after the other, as the paper does; the result is the start of the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from . import TESTS
from .base import Graph, Reading, Rig, RigConfig, Tied

DEFAULT_TIES = {"K_m": "K_b"}  # energy conservation, SI


@dataclass(frozen=True, eq=False)
class Readings:
    """The readings of all graphs."""

    # SI, by symbol, from the first test that reads it. Also `J_eq`, `B_eq`, `series_ohm.<test>`
    values: Mapping[str, float]
    source: Mapping[str, str]  # the test each value comes from
    nominal: frozenset[str]  # symbols whose scale or split is assumed, not read
    tests: Mapping[str, Reading]  # the reading of each test that has traces, in order

    @property
    def graphs(self) -> dict[str, tuple[Graph, ...]]:
        """Graphs by rig test."""
        return {name: reading.graphs for name, reading in self.tests.items()}


def read_graphs(rig: Rig) -> Readings:
    """Run all tests' readings, in order, over the traces that are neither held out nor set aside.

    Later tests use the readings of earlier ones; a reading replaces a value of rig.toml unless rig.toml fixes it.
    """
    values: dict[str, float] = {}
    source: dict[str, str] = {}
    nominal: set[str] = set()
    tests: dict[str, Reading] = {}
    for test in TESTS:
        every = (m for m in rig.measurements if m.test == test.name and not m.held_out)
        traces = [m for m in every if not rig.config.sets_aside(m)]
        if not traces:
            continue
        reading = tests[test.name] = test.reading(traces, rig.config, known(rig.config, values))
        new = {symbol: value for symbol, value in reading.values.items() if symbol not in values}
        values |= new
        source |= dict.fromkeys(new, test.name)
        nominal |= set(reading.nominal) & set(new)
    return Readings(_with_ties(values, rig.config), source, frozenset(nominal), tests)


def known(config: RigConfig, read: Mapping[str, float]) -> dict[str, float]:
    """Values for the next reading, SI: those given in rig.toml, replaced by those read unless fixed, ties, and N."""
    given = {symbol: k.value for symbol, k in config.parameters.items() if not isinstance(k, Tied)}
    return _with_ties({**given, **read, **config.fixed, "N": config.gear_ratio}, config)


def _with_ties(values: Mapping[str, float], config: RigConfig) -> dict[str, float]:
    ties = {symbol: k.to for symbol, k in config.parameters.items() if isinstance(k, Tied)}
    untold = {symbol: to for symbol, to in DEFAULT_TIES.items() if symbol not in config.parameters}
    return {**values, **{symbol: values[to] for symbol, to in {**untold, **ties}.items() if to in values}}
