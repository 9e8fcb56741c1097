"""Nothing that meets what is required lies below the line of the best; what does lie there says what it misses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import exports
from etcfit.control.design import Design
from etcfit.control.judged import Tuned
from etcfit.control.loop_figures import LoopFigures
from etcfit.control.pid import Requirements
from etcfit.control.pid.base import Task
from etcfit.control.pid.optimal import FrontPoint
from etcfit.control.settings import DesignSettings
from etcfit.reporting.control.pictures import draw_front
from partial import partial

GOOD = LoopFigures(10.0, 0.1, 0.2, 1.0, 12.0, 45.0, 4.0)


def rule(name: str, **changes: Any) -> Tuned:
    figures = replace(GOOD, **changes)
    return partial(Tuned, rule=name, linear=figures, nonlinear=figures)


def design(*rules: Tuned, front: tuple[tuple[float, float, bool], ...] = ()) -> Design:
    """Gains of the first rule; points of the front as activity, error and whether the rest is met."""
    points = tuple(partial(FrontPoint, activity=a, rmse=e, meets=m) for a, e, m in front)
    task = partial(Task, requirements=Requirements(), settings=DesignSettings())
    return partial(Design, front=points, tuned={each.rule: each for each in rules}, chosen=rules[0],
                   fitted=exports.source().fitted, task=task)  # fmt: skip


def line(panel: Any) -> np.ndarray:
    """Activity and error along the line of the best, shape (2, K)."""
    (found,) = (each for each in panel.lines if each.get_label().startswith("least error"))
    return np.array(found.get_data())


FRONT = ((8.0, 0.5, True), (5.0, 0.8, True), (2.0, 0.3, False))


def test_a_rule_below_the_line_is_named_with_what_it_misses() -> None:
    quick = rule("quick", duty_activity_pct=6.0, rmse_pct=0.4, overshoot_pct=65.4)
    (panel,) = draw_front(design(rule("optimal"), quick, front=FRONT)).axes
    assert "quick: overshoot 65.4 % (limit 20 %)" in [text.get_text() for text in panel.texts]
    crosses = [each for each in panel.lines if each.get_marker() == "x"]
    assert [each.get_data() for each in crosses] == [([6.0], [0.4])]


def test_no_rule_that_meets_the_rest_lies_below_the_line() -> None:
    calm, quick = (rule(name, duty_activity_pct=activity, rmse_pct=error)
                   for name, activity, error in (("calm", 3.0, 0.9), ("quick", 6.0, 0.4)))  # fmt: skip
    rules = rule("optimal"), calm, quick
    (panel,) = draw_front(design(*rules, front=FRONT)).axes
    activity, error = line(panel)
    for each in rules:
        m = each.nonlinear
        assert m is not None
        if m.duty_activity_pct >= activity[0]:
            assert m.rmse_pct >= np.interp(m.duty_activity_pct, activity, error) - 1e-12
    assert np.all(np.diff(error) < 0.0)
    assert 2.0 not in activity  # a point of the front that misses something else


@pytest.mark.parametrize("changes", [{"gain_margin_db": -1.0}, {"phase_margin_deg": 20.0}, {"settling_s": np.inf}])
def test_margins_and_stability_count_too(changes: dict[str, float]) -> None:
    made = design(rule("optimal"), rule("wild", duty_activity_pct=3.0, rmse_pct=0.1, **changes), front=FRONT)
    (panel,) = draw_front(made).axes
    assert 0.1 not in line(panel)[1]
    assert any(text.get_text().startswith("wild: ") for text in panel.texts)


def test_axes_and_labels_have_units() -> None:
    (panel,) = draw_front(design(rule("optimal"), front=FRONT)).axes
    assert panel.get_ylabel() == "tracking error, root mean square [% of travel]"
    assert panel.get_xlabel().endswith("[% of the supply]")
