"""Sampling a posterior that is known; a chain too short is refused; an interruption changes nothing."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.estimation.joint_fit import quiet
from etcfit.posterior import ensemble
from etcfit.posterior.chain import BLOCK, Chain, Convergence, Damaged, load, run, save, split_rhat
from etcfit.posterior.ensemble import Ensemble
from etcfit.posterior.settings import SamplingSettings
from gaussian import SEEDS, Linear

LINEAR = Linear.make()
FILE = "chain.npz"


def sampled(
    path: Path, most: int, guess: float = 1.0, settings: SamplingSettings = SamplingSettings()
) -> tuple[Chain, Convergence]:
    return run(LINEAR.log_probability, LINEAR.symbols, lambda: LINEAR.begin(guess), path / FILE, most, quiet, settings)


def same(a: Chain, b: Chain) -> None:
    for one, other in zip(a.ensembles, b.ensembles, strict=True):
        assert_array_equal(one.points, other.points)
        assert_array_equal(one.log_probability, other.log_probability)
        assert_array_equal(one.accepted, other.accepted)


@pytest.mark.parametrize("guess", [1.0, 0.3, 3.0])
def test_a_linear_gaussian_posterior_is_found_also_from_a_wrong_covariance(tmp_path: Path, guess: float) -> None:
    chain, here = sampled(tmp_path, 20_000, guess=guess)
    assert here.converged, here.reason
    draws = chain.coordinates(here.burn).reshape(-1, 3)
    sd = np.sqrt(np.diag(LINEAR.covariance))
    error = 1.0 / np.sqrt(here.effective)
    assert_allclose(draws.mean(axis=0), LINEAR.mean, atol=4.0 * error * float(np.max(sd)), rtol=0)
    assert np.all(np.abs(draws.mean(axis=0) - LINEAR.mean) < 4.0 * error * sd)
    assert_allclose(draws.std(axis=0), sd, rtol=4.0 * error)
    assert_allclose(np.corrcoef(draws.T), LINEAR.covariance / np.outer(sd, sd), atol=4.0 * error)


def test_a_guess_far_too_wide_in_one_direction_costs_no_steps(tmp_path: Path) -> None:
    """As from the curvature at a bound, where a parameter changes nothing."""
    linear = Linear.make(size=8)
    wide = linear.covariance + np.diag((100.0 * np.sqrt(np.diag(linear.covariance)) * (np.arange(8) == 3)) ** 2)

    def begin() -> Chain:
        return Chain.begin(linear.log_probability, linear.symbols, linear.mean + np.sqrt(np.diag(wide)), wide, SEEDS)

    chain, here = run(linear.log_probability, linear.symbols, begin, tmp_path / FILE, 600, quiet)
    assert here.converged, here.reason
    draws = chain.coordinates(here.burn).reshape(-1, 8)
    assert_allclose(draws.std(axis=0), np.sqrt(np.diag(linear.covariance)), rtol=4.0 / np.sqrt(here.effective))


def test_it_stops_by_itself_once_the_chain_is_long_enough(tmp_path: Path) -> None:
    chain, here = sampled(tmp_path, 20_000)
    assert here.steps < 2_000
    assert here.steps - here.burn > SamplingSettings().length * here.longest
    before = Convergence.judge(tuple(_shorter(e, here.steps - BLOCK) for e in chain.ensembles))
    assert not before.converged


def _shorter(e: Ensemble, steps: int) -> Ensemble:
    return Ensemble(e.points[: steps + 1], e.log_probability[: steps + 1], e.accepted, e.random)


def test_a_short_chain_is_no_posterior_and_says_how_much_longer_it_must_be(tmp_path: Path) -> None:
    long = SamplingSettings(length=200.0)
    _, here = sampled(tmp_path, 100, settings=long)
    assert (here.converged, here.steps) == (False, 100)
    assert "200 are needed" in here.reason
    lacking = here.needed - here.steps
    assert f"About {lacking} more steps" in here.reason
    assert lacking > 0
    _, later = sampled(tmp_path, here.needed + 10 * BLOCK, settings=long)
    assert later.converged, later.reason


def verdict(**changes: Any) -> Convergence:
    """Of a chain of 1000 steps after a burn-in of 100, tau 10 steps, whose ensembles agree."""
    plain = Convergence(1100, 100, np.array([10.0, 4.0]), np.array([10.0, 4.0]), np.array([1.0, 1.0]), 0.4, 800.0)
    return replace(plain, **changes)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, None),
        ({"tau": np.array([4.0, 20.5]), "earlier": np.array([4.0, 20.5])}, "49 tau long where 50 are needed"),
        ({"earlier": np.array([9.5, 4.0])}, "tau still changes, by 5 %"),
        ({"earlier": np.array([9.6, 4.0])}, None),
        ({"rhat": np.array([1.0, 1.011])}, "the ensembles disagree (R-hat 1.011, 1.01 allowed)"),
        ({"rhat": np.array([1.0, 1.009])}, None),
        ({"tau": np.full(2, np.nan)}, "1100 steps are too few to say anything"),
    ],
)
def test_a_verdict_is_a_function_of_length_drift_and_agreement(changes: dict[str, Any], fault: str | None) -> None:
    here = verdict(**changes)
    assert here.converged == (fault is None)
    assert all(fault in found for found in here.faults) if fault else here.faults == ()
    assert (here.needed > here.steps) == (fault is not None and "too few" not in fault)


def test_thresholds_of_the_verdict_are_settings() -> None:
    assert not verdict(settings=SamplingSettings(length=101.0)).converged
    assert verdict(rhat=np.array([1.0, 1.05]), settings=SamplingSettings(alike=1.1)).converged
    assert verdict(earlier=np.array([5.0, 4.0]), settings=SamplingSettings(still=1.1)).converged
    assert verdict(settings=SamplingSettings(length=200.0)).needed == 200 * 10 * 1.1 + 100


def test_walkers_and_seeds_are_settings() -> None:
    def begun(**changes: Any) -> Chain:
        settings = SamplingSettings(**changes)
        return Chain.begin(LINEAR.log_probability, ("a", "b", "c"), LINEAR.mean, LINEAR.covariance, settings)

    assert [e.points.shape for e in begun(seeds=(1, 2, 3)).ensembles] == [(1, 9, 3)] * 3
    assert begun(walkers_per_coordinate=6, seeds=(1,)).ensembles[0].points.shape[1] == 18
    one, other = begun(seeds=(1, 2)).ensembles
    assert not np.array_equal(one.points, other.points)
    same(begun(seeds=(1,)), begun(seeds=(1,)))


def test_a_walker_drawn_where_there_is_no_density_is_moved_towards_the_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Uniform within 0.5 of the mode: a standard normal in two dimensions hardly ever falls into it."""

    def boxed(u: np.ndarray) -> np.ndarray:
        return np.where(np.max(np.abs(u), axis=1) < 0.5, 0.0, -np.inf)

    begun = Ensemble.begin(boxed, 2, seed=1)
    assert np.isfinite(begun.log_probability).all()
    monkeypatch.setattr(ensemble, "HALVINGS", 0)
    left_alone = Ensemble.begin(boxed, 2, seed=1)
    assert not np.isfinite(left_alone.log_probability).all()


def test_very_few_steps_say_nothing_at_all(tmp_path: Path) -> None:
    _, here = sampled(tmp_path, 10)
    assert not here.converged
    assert "too few" in here.reason


def test_ensembles_that_disagree_are_no_posterior() -> None:
    rng = np.random.default_rng(0)
    chains = [rng.standard_normal((400, 12, 2)), rng.standard_normal((400, 12, 2)) + np.array([0.0, 0.5])]
    alike, apart = split_rhat(chains)
    assert alike < 1.01 < apart
    ensembles = [Ensemble(points, points[:, :, 0], np.zeros(12), None) for points in chains]
    here = Convergence.judge(ensembles)
    assert here.longest < 2.0
    assert "disagree" in here.reason


def test_a_resumed_run_equals_one_that_was_never_interrupted(tmp_path: Path) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    uninterrupted, _ = sampled(whole, 3 * BLOCK)
    for most in (BLOCK, 2 * BLOCK, 3 * BLOCK):
        resumed, _ = sampled(parts, most)
    same(uninterrupted, resumed)


def test_a_chain_survives_its_file(tmp_path: Path) -> None:
    chain = LINEAR.begin().advanced(LINEAR.log_probability, 7)
    save(tmp_path / FILE, chain)
    back = load(tmp_path / FILE)
    assert back is not None
    same(chain, back)
    same(chain.advanced(LINEAR.log_probability, 5), back.advanced(LINEAR.log_probability, 5))


def remarked(path: Path, linear: Linear) -> tuple[Chain, list[str]]:
    """One block, and what was said besides."""
    said: list[str] = []
    target, settings = linear.log_probability, SamplingSettings()
    chain, _ = run(target, linear.symbols, lambda: linear.begin(1.0), path, BLOCK, quiet, settings, said.append)
    return chain, said


def test_a_chain_of_other_data_is_put_aside_with_a_word(tmp_path: Path) -> None:
    path, other = tmp_path / FILE, Linear.make(seed=6)
    sampled(tmp_path, BLOCK)
    hours_of_work = path.read_bytes()
    chain, (said,) = remarked(path, other)
    same(chain, other.begin().advanced(other.log_probability, BLOCK))
    assert f"belongs to another model or other data: it was moved to {tmp_path / 'superseded' / FILE}" in said
    assert (tmp_path / "superseded" / FILE).read_bytes() == hours_of_work
    assert remarked(path, other)[1] == []


def _flipped(content: bytes, place: float) -> bytes:
    changed = bytearray(content)
    changed[int(place * len(changed))] ^= 1
    return bytes(changed)


def _other_arrays(content: bytes) -> bytes:
    held = io.BytesIO()
    np.savez(held, symbols=np.array(["a"]), mode=np.zeros(1), root=np.eye(2))
    return held.getvalue()


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "no zip at all": lambda content: b"PK nothing",
    "empty": lambda content: b"",
    "cut off": lambda content: content[: len(content) // 2],
    "a bit of the points": lambda content: _flipped(content, 0.3),
    "a bit later": lambda content: _flipped(content, 0.8),
    "another kind of file": _other_arrays,
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_chain_is_put_aside_with_a_word_and_never_over_another(tmp_path: Path, name: str) -> None:
    path, aside = tmp_path / FILE, tmp_path / "superseded"
    whole, _ = sampled(tmp_path, BLOCK)
    aside.mkdir()
    (aside / FILE).write_bytes(b"of an earlier time")
    path.write_bytes(DAMAGE[name](path.read_bytes()))
    damaged = path.read_bytes()
    with pytest.raises(Damaged):
        load(path)
    again, (said,) = remarked(path, LINEAR)
    same(again, whole)
    assert "cannot be read" in said
    assert f"it was moved to {aside / 'chain_2.npz'}" in said
    assert {file.name: file.read_bytes() for file in aside.iterdir()} == {
        FILE: b"of an earlier time",
        "chain_2.npz": damaged,
    }


def test_an_interruption_between_blocks_loses_only_the_block(tmp_path: Path) -> None:
    def interrupt(text: str, share: float) -> None:
        if f"step {2 * BLOCK}" in text:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(LINEAR.log_probability, LINEAR.symbols, LINEAR.begin, tmp_path / FILE, 20_000, interrupt)
    kept = load(tmp_path / FILE)
    assert kept is not None
    assert kept.ensembles[0].steps == 2 * BLOCK


def test_progress_tells_acceptance_tau_effective_samples_and_time_left(tmp_path: Path) -> None:
    said: list[tuple[str, float]] = []
    run(
        LINEAR.log_probability,
        LINEAR.symbols,
        LINEAR.begin,
        tmp_path / FILE,
        2 * BLOCK,
        lambda *each: said.append(each),
    )
    assert len(said) == 2
    text, share = said[-1]
    assert all(word in text for word in ("% accepted", "tau", "effective samples", "left"))
    assert 0.0 < share <= 1.0


CHILD = """
import sys, time
from pathlib import Path
from gaussian import SEEDS, Linear
from etcfit.estimation.joint_fit import quiet
from etcfit.posterior.chain import run
linear = Linear.make()
def slowly(points):
    time.sleep(0.002)
    return linear.log_probability(points)
run(slowly, linear.symbols, linear.begin, Path(sys.argv[1]), 20_000, quiet)
"""


@pytest.mark.slow  # a process of its own imports JAX
def test_a_run_killed_outright_goes_on_as_if_nothing_had_happened(tmp_path: Path) -> None:
    path = tmp_path / FILE
    root = Path(__file__).resolve().parents[2]
    places = os.pathsep.join(map(str, (root, root / "tests")))
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(path)], env=os.environ | {"PYTHONPATH": places})
    try:
        deadline = time.monotonic() + 120.0
        while ((kept := load(path)) is None or kept.ensembles[0].steps < 2 * BLOCK) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    assert child.returncode == -signal.SIGKILL
    kept = load(path)
    assert kept is not None
    steps = kept.ensembles[0].steps
    assert steps >= 2 * BLOCK
    assert steps % BLOCK == 0
    resumed, _ = sampled(tmp_path, steps + 2 * BLOCK)
    uninterrupted, _ = sampled(tmp_path / "other", steps + 2 * BLOCK)
    same(resumed, uninterrupted)
