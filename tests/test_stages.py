"""`etcfit run` does what is not done, in order, and begins again what was interrupted."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from etcfit.stages import STAGES, Done, Report, Stage, is_done, run_all


class Bench:
    """A measurement folder, a run folder, and three stages that only write their files."""

    def __init__(self, base: Path) -> None:
        self.folder, self.run, self.said = base / "rig", base / "run", []
        (self.folder / "response").mkdir(parents=True)
        for name in ("rig.toml", "response/1.csv", "response/2.csv"):
            (self.folder / name).write_text("a", encoding="utf-8")
        self.interrupt = ""
        self.stages = (
            self.stage("one", ("fit.json",), ()),
            self.stage("two", ("two.json", "two.npz"), ("fit.json",)),
            self.stage("three", ("three.html",), ("fit.json", "two.json", "never.json")),
        )
        self.clock = 1_000_000_000
        for path in self.folder.rglob("*"):
            self.touch(path)

    def touch(self, path: Path) -> None:
        """Files written one after the other are a second apart, whatever the disk's clock resolves."""
        self.clock += 1
        os.utime(path, (self.clock, self.clock))

    def stage(self, name: str, makes: tuple[str, ...], needs: tuple[str, ...]) -> Stage:
        def work(folder: Path, run: Path, report: Report) -> Done:
            assert folder == self.folder
            report(name, 0.5)
            for file in makes:
                (run / file).write_text('{"converged": true}', encoding="utf-8")
                self.touch(run / file)
                if self.interrupt == file:
                    raise KeyboardInterrupt
            return Done(f"{name} done")

        return Stage(name, makes, needs, work)

    def go(self) -> list[str]:
        """Names of the stages that were run."""
        self.said = []
        run_all(self.folder, self.run, self.progress, self.show, self.stages)
        return self.said

    @contextmanager
    def progress(self) -> Iterator[Report]:
        yield lambda stage, done: None

    def show(self, name: str, done: Done | None) -> None:
        if done is not None:
            assert done.shown == f"{name} done"
            self.said.append(name)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_a_second_time_there_is_nothing_to_do(bench: Bench) -> None:
    assert bench.go() == ["one", "two", "three"]
    assert bench.go() == []
    assert sorted(p.name for p in bench.run.iterdir()) == ["fit.json", "three.html", "two.json", "two.npz"]


CHANGES: dict[str, tuple[Callable[[Bench], object], list[str]]] = {
    "a trace is measured again": (lambda b: b.touch(b.folder / "response/1.csv"), ["one", "two", "three"]),
    "rig.toml is edited": (lambda b: b.touch(b.folder / "rig.toml"), ["one", "two", "three"]),
    "a trace is taken away": (lambda b: (b.folder / "response/2.csv").unlink(), ["one", "two", "three"]),
    "one result is gone": (lambda b: (b.run / "two.npz").unlink(), ["two", "three"]),
    "the fit was made again by hand": (lambda b: b.touch(b.run / "fit.json"), ["two", "three"]),
    "the page is gone": (lambda b: (b.run / "three.html").unlink(), ["three"]),
    "a picture is opened": (lambda b: (b.run / "other.txt").write_text(""), []),
}


@pytest.mark.parametrize(("change", "again"), CHANGES.values(), ids=CHANGES)
def test_what_is_older_than_what_it_is_made_from_is_made_again(
    bench: Bench, change: Callable[[Bench], object], again: list[str]
) -> None:
    bench.go()
    change(bench)
    assert bench.go() == again


@pytest.mark.parametrize(("file", "again"), [("fit.json", ["one", "two", "three"]), ("two.npz", ["two", "three"])])
def test_an_interrupted_stage_is_begun_again(bench: Bench, file: str, again: list[str]) -> None:
    # even where all its files are there: pictures may be missing
    bench.interrupt = file
    with pytest.raises(KeyboardInterrupt):
        bench.go()
    bench.interrupt = ""
    assert bench.go() == again
    assert bench.go() == []


def test_a_fit_that_did_not_converge_is_told_also_where_it_was_skipped(bench: Bench) -> None:
    bench.go()
    (bench.run / "fit.json").write_text('{"converged": false, "reason": "too rough"}', encoding="utf-8")
    failure = run_all(bench.folder, bench.run, bench.progress, bench.show, ())
    assert failure == "the fit of the final model did not converge: too rough"


def test_the_list_is_in_order() -> None:
    """What a stage needs is made by those before it, and the report comes last and needs them all."""
    made: set[str] = set()
    for stage in STAGES[:-1]:
        assert set(stage.needs) <= made
        made |= set(stage.makes)
    assert STAGES[-1].name == "report"
    assert {name for name in made if name.endswith(".json")} <= set(STAGES[-1].needs)


def test_without_files_nothing_is_done(bench: Bench) -> None:
    bench.run.mkdir()
    assert not any(is_done(stage, bench.folder, bench.run) for stage in bench.stages)
