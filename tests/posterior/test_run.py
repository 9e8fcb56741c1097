"""Sampling a posterior that is known; a chain too short is refused; an interruption changes nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.estimation.joint_fit import quiet
from etcfit.posterior.chain import Chain, load, save
from etcfit.posterior.convergence import LENGTH, Convergence, split_rhat
from etcfit.posterior.ensemble import Ensemble
from etcfit.posterior.run import BLOCK, run
from gaussian import Linear

LINEAR = Linear.make()
FILE = "chain.npz"


def sampled(path: Path, most: int, linear: Linear = LINEAR, guess: float = 1.0) -> tuple[Chain, Convergence]:
    return run(linear.log_probability, lambda: linear.begin(guess), path / FILE, most, quiet)


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


def test_it_stops_by_itself_once_the_chain_is_long_enough(tmp_path: Path) -> None:
    chain, here = sampled(tmp_path, 20_000)
    assert here.steps < 2_000
    assert here.steps - here.burn > LENGTH * here.longest
    before = Convergence.of(tuple(_shorter(e, here.steps - BLOCK) for e in chain.ensembles))
    assert not before.converged


def _shorter(e: Ensemble, steps: int) -> Ensemble:
    return Ensemble(e.points[: steps + 1], e.log_probability[: steps + 1], e.accepted, e.random)


def test_a_short_chain_is_no_posterior_and_says_how_much_longer_it_must_be(tmp_path: Path) -> None:
    _, here = sampled(tmp_path, 100)
    assert (here.converged, here.steps) == (False, 100)
    assert f"{LENGTH:.0f} are needed" in here.reason
    lacking = here.needed - here.steps
    assert f"About {lacking} more steps" in here.reason
    assert lacking > 0
    _, later = sampled(tmp_path, here.needed + 10 * BLOCK)
    assert later.converged, later.reason


def test_very_few_steps_say_nothing_at_all(tmp_path: Path) -> None:
    _, here = sampled(tmp_path, 10)
    assert not here.converged
    assert "too few" in here.reason


def test_ensembles_that_disagree_are_no_posterior() -> None:
    rng = np.random.default_rng(0)
    chains = [rng.standard_normal((400, 12, 2)), rng.standard_normal((400, 12, 2)) + np.array([0.0, 0.5])]
    alike, apart = split_rhat(chains)
    assert alike < 1.01 < apart
    chain = Chain.begin(LINEAR.log_probability, ("a", "b"), np.zeros(2), np.eye(2), ()).ensembles
    assert chain == ()
    ensembles = [Ensemble(points, points[:, :, 0], np.zeros(12), None) for points in chains]
    here = Convergence.of(ensembles)
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


def test_a_chain_of_other_data_or_a_broken_file_is_not_taken_up(tmp_path: Path) -> None:
    sampled(tmp_path, BLOCK)
    other = Linear.make(seed=6)
    reprepared, _ = sampled(tmp_path, BLOCK, other)
    same(reprepared, other.begin().advanced(other.log_probability, BLOCK))
    (tmp_path / FILE).write_bytes(b"PK nothing")
    assert load(tmp_path / FILE) is None
    again, _ = sampled(tmp_path, BLOCK, other)
    same(again, reprepared)


def test_an_interruption_between_blocks_loses_only_the_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(text: str, share: float) -> None:
        if f"step {2 * BLOCK}" in text:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(LINEAR.log_probability, LINEAR.begin, tmp_path / FILE, 20_000, interrupt)
    kept = load(tmp_path / FILE)
    assert kept is not None
    assert kept.ensembles[0].steps == 2 * BLOCK


def test_progress_tells_acceptance_tau_effective_samples_and_time_left(tmp_path: Path) -> None:
    said: list[tuple[str, float]] = []
    run(LINEAR.log_probability, LINEAR.begin, tmp_path / FILE, 4 * BLOCK, lambda *each: said.append(each))
    assert len(said) == 4
    text, share = said[-1]
    assert all(word in text for word in ("% accepted", "tau", "effective samples", "left"))
    assert 0.0 < share <= 1.0


CHILD = """
import sys, time
from pathlib import Path
from gaussian import Linear
from etcfit.estimation.joint_fit import quiet
from etcfit.posterior.run import run
linear = Linear.make()
def slowly(points):
    time.sleep(0.002)
    return linear.log_probability(points)
run(slowly, linear.begin, Path(sys.argv[1]), 20_000, quiet)
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
