"""Progress is shown where somebody looks and nowhere else."""

from __future__ import annotations

import io
import sys
from typing import Any

import pytest

from etcfit.api import progress as progress_
from etcfit.api.progress import notebook_bar, progress, silent, terminal_bar


class Kernel:
    """What IPython says inside of Jupyter."""

    kernel = object()


def test_an_output_that_nobody_looks_at_gets_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with progress() as report:
        assert report is silent
        report("half done", 0.5)
    assert capfd.readouterr() == ("", "")


def test_somebody_else_may_say_what_happens_there() -> None:
    said: list[str] = []
    with progress(elsewhere=lambda: lambda stage, done: said.append(stage)) as report:
        report("half done", 0.5)
    assert said == ["half done"]


def test_quiet_is_quiet_on_a_terminal_and_in_a_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(progress_, "in_notebook", lambda: True)
    with progress(quiet=True) as report:
        assert report is silent


def test_a_terminal_shows_a_bar_with_the_stage_as_it_is_written() -> None:
    from rich.console import Console

    out = io.StringIO()
    with terminal_bar(Console(file=out, force_terminal=True, width=100)) as report:
        report("fitting [2/3]", 0.5)
    assert "fitting [2/3]" in out.getvalue()


def test_a_notebook_shows_a_bar_that_is_escaped_and_wiped_away(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    class Handle:
        def display(self, page: Any) -> None:
            shown.append(page.data)

        update = display

    monkeypatch.setattr("IPython.display.DisplayHandle", Handle)
    with notebook_bar(every=0.0) as report:
        report("chi2 <b> & more", 0.25)
        report("beyond", 7.0)
    assert 'value="0.250"' in shown[1]
    assert "chi2 &lt;b&gt; &amp; more" in shown[1]
    assert 'value="1.000"' in shown[2]
    assert shown[-1] == ""


def test_a_kernel_is_a_notebook_and_a_terminals_ipython_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    import IPython

    assert not progress_.in_notebook()
    monkeypatch.setattr(IPython, "get_ipython", lambda: object())
    assert not progress_.in_notebook()
    monkeypatch.setattr(IPython, "get_ipython", Kernel)
    assert progress_.in_notebook()
