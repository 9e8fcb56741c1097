"""A fit in a notebook: tables with types, a short repr, an escaped table that hides nothing, traces by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import results
from etcfit.api.fit import Fit
from etcfit.errors import UsageError
from etcfit.estimation.intervals import intervals
from etcfit.rig.base import Rig
from pages import Reader

COLUMNS = {"value": "float64", "stderr": "float64", "low": "float64", "high": "float64", "unit": "str", "status": "str"}


def named(fit: Fit, name: str, **changes: bool) -> Fit:
    """The same fit of a rig of another name."""
    rig = fit.result.rig
    return Fit(replace(fit.result, rig=replace(rig, config=replace(rig.config, name=name, **changes))))


def test_parameters_are_what_the_intervals_say_and_typed(fitted: Fit) -> None:
    frame, known = fitted.parameters, intervals(fitted.result)
    assert {name: str(kind) for name, kind in frame.dtypes.items()} == COLUMNS
    assert frame.index.name == "symbol"
    assert list(frame.index) == list(known)
    row = frame.loc["R_a"]
    assert (row["value"], row["stderr"], row["low"], row["high"]) == (
        known["R_a"].value, known["R_a"].stderr, known["R_a"].low, known["R_a"].high,
    )  # fmt: skip
    assert (row["unit"], row["status"]) == ("ohm", "estimated")
    assert dict(fitted.combinations.dtypes) == dict(frame.dtypes)
    assert "J_eq" in fitted.combinations.index


def test_what_has_no_interval_has_none_in_the_table(fitted: Fit) -> None:
    frame = fitted.parameters
    for symbol, status in {"J_L": "not identifiable", "B_m": "fixed", "N": "fixed"}.items():
        assert frame.loc[symbol, "status"] == status
        assert frame.loc[symbol, ["stderr", "low", "high"]].isna().all()


def test_a_table_is_the_callers_own(fitted: Fit) -> None:
    frame = fitted.parameters
    frame.loc["R_a", "value"] = 0.0
    assert fitted.parameters.loc["R_a", "value"] != 0.0


def test_the_score_has_a_row_a_file_and_channel(fitted: Fit) -> None:
    frame, result = fitted.score, fitted.result
    assert list(frame.index) == [(r.file, r.channel) for r in (*result.score_fit, *result.score_holdout)]
    assert list(frame[frame["held_out"]].index) == [(r.file, r.channel) for r in result.score_holdout]
    np.testing.assert_allclose(frame["in_sigma"], frame["rms"] / frame["sigma"], rtol=0)
    assert frame.loc[("response/2.csv", "current"), "unit"] == "mA"


def test_a_trace_of_several_channels_has_columns_for_each(fitted: Fit) -> None:
    trace = fitted.trace("response/1.csv")
    frame = trace.to_frame()
    expected = ["time", *(f"{c}_{w}" for c in ("current", "position") for w in ("measured", "simulated", "residual"))]
    assert list(frame.columns) == expected == list(trace.units)
    assert set(map(str, frame.dtypes)) == {"float64"}
    logged = trace.trace.measurement.channels["current"]
    np.testing.assert_allclose(frame["current_measured"], logged.logged(logged.value), rtol=1e-12)
    assert frame.attrs["units"] | {} == trace.units
    assert (trace.units["current_measured"], trace.units["position_residual"]) == ("mA", "sigma")


def test_a_trace_of_one_channel_needs_no_prefix(fitted: Fit) -> None:
    frame = fitted.trace("resistance/1.csv").to_frame()
    assert list(frame.columns) == ["time", "measured", "simulated", "residual"]


def test_the_residual_is_the_score(fitted: Fit) -> None:
    for row in fitted.score.reset_index().to_dict("records"):
        trace = fitted.trace(row["file"])
        column = "residual" if len(trace.channels) == 1 else f"{row['channel']}_residual"
        rms = float(np.sqrt(np.nanmean(trace.to_frame()[column] ** 2)))
        assert rms == pytest.approx(row["in_sigma"], rel=1e-9)


def test_a_trace_that_is_not_there_is_answered_with_those_that_are(fitted: Fit) -> None:
    with pytest.raises(UsageError) as caught:
        fitted.trace("response/9.csv")
    assert all(file in str(caught.value) for file in (*fitted.traces, "response/9.csv"))
    assert set(fitted.traces) == {m.file for m in fitted.result.rig.measurements}
    assert fitted.trace("response/2.csv").held_out
    assert fitted.trace("response/2.csv").whitened is None
    assert fitted.trace("response/1.csv").whitened is not None


def test_reprs_are_short_and_say_what_matters(fitted: Fit) -> None:
    text = repr(fitted)
    assert len(text) < 1500
    assert text.count("\n") < 12
    assert "SYNTHETIC" in text
    assert "not identifiable: J_L" in text
    assert "1 warning," in text
    assert "array(" not in text
    assert len(repr(fitted.result)) < 200
    assert "\n" not in repr(fitted.result)
    assert len(repr(fitted.trace("response/1.csv"))) < 200


def test_a_repr_stays_short_whatever_is_in_it(fitted: Fit) -> None:
    long = Fit(replace(named(fitted, "long " * 2000).result, reason="because " * 2000, converged=False))
    assert len(repr(long)) < 1500
    assert "NOT CONVERGED" in repr(long)
    assert "not identifiable: J_L" in repr(long)


def test_the_html_table_escapes_a_name_and_shows_no_number_that_is_not_known(fitted: Fit) -> None:
    page = named(fitted, "a <b>bold</b> & <script>alert(1)</script> rig")._repr_html_()
    seen = Reader(page)
    assert "<script" not in page
    assert "&lt;b&gt;bold&lt;/b&gt; &amp;" in page
    assert seen.of("script") == []
    assert "SYNTHETIC DATA" in seen.text
    assert "NOT CONVERGED" not in seen.text
    row = next(part for part in page.split("<tr>") if "J_L" in part)
    assert "not identifiable" in row
    assert f"{fitted.parameters.loc['J_L', 'value']:.3g}"[:4] not in row
    assert row.count(">-<") == 4
    assert len(page) < 20_000


def test_the_html_table_says_that_a_fit_did_not_converge(rig: Rig) -> None:
    fit = Fit(results.result(rig, converged=False, reason="it <i>wandered</i>"))
    seen = Reader(fit._repr_html_())
    assert "NOT CONVERGED: it <i>wandered</i>" in seen.text
    assert seen.of("i") == []
    assert "NOT CONVERGED" in repr(fit)


def test_measured_data_are_not_called_synthetic(fitted: Fit) -> None:
    fit = named(fitted, "bench", synthetic=False)
    assert "SYNTHETIC" not in fit._repr_html_() + repr(fit)
