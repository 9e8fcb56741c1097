"""Progress is shown where somebody looks and nowhere else."""

from __future__ import annotations

import io
import sys
import threading
from typing import Any

import pytest

from etcfit.api import progress as progress_
from etcfit.api.progress import (
    Expected,
    Lines,
    Remaining,
    in_words,
    notebook_bar,
    part_of,
    plain_lines,
    progress,
    silent,
    terminal_bar,
)


class Kernel:
    """What IPython says inside of Jupyter."""

    kernel = object()


def test_an_output_that_nobody_looks_at_gets_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    with progress() as report:
        assert report is silent
        report("half done", 0.5)
    assert capfd.readouterr() == ("", "")


def test_lines_say_there_what_happens() -> None:
    said: list[str] = []
    with progress(say=said.append) as report:
        report("half done", 0.5)
        report("half done", 0.6)
    assert said == ["half done"]


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize(
    ("seconds", "words"), [(1.0, "5 s"), (42.0, "40 s"), (88.0, "90 s"), (100.0, "2 min"), (7200.0, "2 h")]
)
def test_a_duration_is_as_coarse_as_an_estimate(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


def test_what_is_left_comes_of_the_pace_so_far_once_there_is_one() -> None:
    clock = Clock()
    left = Remaining(clock=clock)
    assert (left.seconds, str(left)) == (None, "")
    left.update(0.1)
    clock.now = 8.0
    left.update(0.1)
    assert left.seconds is None, "one step says no pace"
    clock.now = 10.0
    left.update(0.25)
    assert left.seconds == pytest.approx(30.0)
    clock.now = 15.0
    assert str(left) == "up to 25 s left"
    clock.now = 100.0
    assert str(left) == "", "it took longer than its pace promised: nothing is known"


def test_a_new_part_of_the_work_has_a_pace_of_its_own() -> None:
    clock = Clock()
    left = Remaining(clock=clock)
    for clock.now, share in ((10.0, 0.5), (20.0, 1.0), (20.0, 0.0), (24.0, 0.1), (30.0, 0.2)):
        left.update(share)
    assert left.seconds == pytest.approx(40.0)
    assert left.elapsed == 30.0


def test_what_was_expected_holds_until_it_is_over() -> None:
    clock = Clock()
    left = Remaining(Expected(60.0, "as last time"), clock)
    for clock.now, share in ((10.0, 0.5), (20.0, 0.8)):
        left.update(share)
    assert str(left) == "about 40 s left"
    clock.now = 61.0
    left.update(0.9)
    assert str(left) == "up to 5 s left"


def test_lines_say_how_far_it_is_at_least_every_half_minute() -> None:
    clock, said = Clock(), []
    lines = Lines(said.append, Expected(100.0, "as last time"), clock)
    lines.report("fitting", 0.2)
    for clock.now in range(1, 70):
        lines.tick()
    assert said == [
        "this takes about 2 min, as last time",
        "fitting (about 2 min left)",
        "fitting (20 % done after 30 s, about 70 s left)",
        "fitting (20 % done after 60 s, about 40 s left)",
    ]


def test_lines_are_said_while_the_work_says_nothing() -> None:
    said: list[str] = []
    heard = threading.Event()

    def say(line: str) -> None:
        said.append(line)
        if len(said) > 1:
            heard.set()

    with plain_lines(say, every=0.0) as report:
        report("compiling", 0.1)
        assert heard.wait(10.0)
    assert said[1].startswith("compiling (10 % done after ")


def test_a_part_of_the_work_is_a_part_of_its_share() -> None:
    seen: list[float] = []
    part = part_of(lambda stage, done: seen.append(done), 0.8, 1.0)
    part("drawing", 0.0)
    part("drawing", 0.5)
    assert seen == [0.8, pytest.approx(0.9)]


def test_quiet_is_quiet_on_a_terminal_and_in_a_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(progress_, "in_notebook", lambda: True)
    with progress(quiet=True) as report:
        assert report is silent


def test_a_terminal_shows_a_bar_with_the_stage_as_it_is_written() -> None:
    from rich.console import Console

    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=100)
    with terminal_bar(Expected(60.0, "as last time"), console) as report:
        report("fitting [2/3]", 0.5)
    assert "fitting [2/3]" in out.getvalue()
    assert "about 60 s left" in out.getvalue()


def test_no_name_gives_a_terminal_orders_through_a_bar() -> None:
    from rich.console import Console

    out = io.StringIO()
    with terminal_bar(console=Console(file=out, force_terminal=True, width=100)) as report:
        report("reading \x1b]0;owned\x07\x9b2J\u202e.csv", 0.5)
    assert "reading (U+001B)]0;owned(U+0007)(U+009B)2J(U+202E).csv" in out.getvalue()
    assert not {"\x07", "\x9b", "\u202e"} & set(out.getvalue())


def test_a_notebook_shows_a_bar_that_is_escaped_and_wiped_away(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []

    class Handle:
        def display(self, page: Any) -> None:
            shown.append(page.data)

        update = display

    monkeypatch.setattr("IPython.display.DisplayHandle", Handle)
    with notebook_bar(every=0.0) as report:
        report("chi2 <b> & \u202emore", 0.25)
        report("beyond", 7.0)
    assert 'value="0.250"' in shown[1]
    assert "chi2 &lt;b&gt; &amp; (U+202E)more" in shown[1]
    assert 'value="1.000"' in shown[2]
    assert shown[-1] == ""


def test_a_kernel_is_a_notebook_and_a_terminals_ipython_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    import IPython

    assert not progress_.in_notebook()
    monkeypatch.setattr(IPython, "get_ipython", lambda: object())
    assert not progress_.in_notebook()
    monkeypatch.setattr(IPython, "get_ipython", Kernel)
    assert progress_.in_notebook()
