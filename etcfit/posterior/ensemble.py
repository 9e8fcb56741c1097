"""An ensemble of walkers: where it begins, how it moves, and how several go on in step. Only here emcee samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any, NamedTuple, TypeVar

import emcee
import numpy as np

from .settings import SamplingSettings

LogProbability = Callable[[np.ndarray], np.ndarray]
Job = TypeVar("Job")
Done = TypeVar("Done")

FREEDOM = 10.0  # degrees of freedom of t
MOST_ROUNDS = 20  # times that the normal density near the one sampled is improved at most
ALIKE_WEIGHTS = 0.25  # share of the draws that their weights must be worth
REFINEMENT = 4  # factor on the draws of the last round
DRAWS_PER_COORDINATE = 40  # draws, for each coordinate, that a normal density near the one sampled is sought with
LEAST_WALKERS = 8  # of each ensemble however few the coordinates; the snooker move needs three others in each half
# a walker is no start where log-probability lies below that of a normal density by more than this many standard
# deviations of its chi2
TYPICAL = 6.0
HALVINGS = 30  # times that such a walker's distance from the mode is halved at most
_HALVINGS_OF_POWER = 40  # of the range in which the power lies


class Approximation(NamedTuple):
    """A normal density over coordinates."""

    mean: np.ndarray  # shape (P,)
    root: np.ndarray  # square root of the covariance, shape (P, P)


def log_t(u: np.ndarray) -> np.ndarray:
    """log density of a standard multivariate t, to a constant, shape (K, P) -> (K,)."""
    return -0.5 * (FREEDOM + u.shape[1]) * np.log1p(np.sum(u**2, axis=1) / FREEDOM)


def drawn_t(count: int, size: int, random: np.random.RandomState) -> np.ndarray:
    """Draws of a standard multivariate t, shape (count, size)."""
    scale = np.sqrt(FREEDOM / random.chisquare(FREEDOM, count))
    return scale[:, None] * random.standard_normal((count, size))


def root_of(covariance: np.ndarray) -> np.ndarray:
    """A square root of a covariance, shape (P, P)."""
    variance, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(variance, 0.0))


def approximate(
    target: LogProbability, mean: np.ndarray, covariance: np.ndarray, settings: SamplingSettings = SamplingSettings()
) -> Approximation:
    """A normal density near the one that is sampled: from it walkers begin, and by it they leap.

        x_i ~ t_10(m, C),    w_i = (p(x_i) / t_10(x_i | m, C))^b,    m, C: mean and covariance of the x_i by w_i

    again and again, each time from the last m and C, until b = 1. The power b <= 1 is the largest that leaves the
    weights of enough draws alike: it is small where the first m and C are poor, and rises as they become better.

    The curvature at the mode alone does not do. Where a parameter lies on its bound it is 0; where plate and friction
    stick and slip the density is rough, and its curvature at one point says little of its width.

    Source: Cappe, Guillin, Marin and Robert 2004 (population Monte Carlo); powers of the weights: Koblents and Miguez
    2015. Differs from source: one t distribution, not a mixture.

    Args:
        target: log-probability of coordinates, shape (K, P) -> (K,).
        mean, covariance: first guess, shapes (P,) and (P, P).
        settings: the first seed.
    """
    random = np.random.RandomState(settings.seeds[0])
    here, count = Approximation(mean, root_of(covariance)), DRAWS_PER_COORDINATE * mean.size
    for _ in range(MOST_ROUNDS):
        here, power = _improved(target, here, count, random)
        if power == 1.0:
            return _improved(target, here, REFINEMENT * count, random)[0]
    return here


def _improved(
    target: LogProbability, here: Approximation, count: int, random: np.random.RandomState
) -> tuple[Approximation, float]:
    """Mean and covariance of so many weighted draws, and the power of their weights; what was there, and 0, where none
    of them has any density."""
    u = drawn_t(count, here.mean.size, random)
    log_weight = target(here.mean + u @ here.root.T) - log_t(u)
    if not np.isfinite(log_weight).any():
        return here, 0.0
    power = _power(log_weight, ALIKE_WEIGHTS * count)
    weight = _weights(log_weight, power)
    middle = weight @ u
    spread = (weight[:, None] * (u - middle)).T @ (u - middle) / (1.0 - weight @ weight)
    return Approximation(here.mean + here.root @ middle, here.root @ root_of(spread)), power


def _weights(log_weight: np.ndarray, power: float) -> np.ndarray:
    """Weights to a power, their sum 1."""
    weight = np.exp(power * (log_weight - np.max(log_weight)))
    return weight / np.sum(weight)


def _power(log_weight: np.ndarray, count: float) -> float:
    """The largest power, at most 1, of weights that are worth at least so many equal ones."""

    def is_enough(power: float) -> bool:
        return 1.0 / float(np.sum(_weights(log_weight, power) ** 2)) >= count

    if is_enough(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS_OF_POWER):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_enough(middle) else (low, middle)
    return low


class Snooker(emcee.moves.RedBlueMove):
    """A walker moves on the line through it and another walker, by what two more differ along that line.

        x' = x + 1.7 e (e . (z1 - z2)),    e = (x - z) / |x - z|
        accepted with probability min(1, p(x') |x' - z|^(P-1) / (p(x) |x - z|^(P-1)))

    Source: ter Braak and Vrugt 2008, eqs. 3 and 4. Differs from source: no. emcee 3.1.6's own DESnookerMove divides by
    the root of the distance where it should divide by the distance, which breaks detailed balance: the variance of a
    standard normal in 8 dimensions comes out as 0.63 (tests/posterior/test_ensemble.py).
    """

    def get_proposal(self, sample: np.ndarray, complement: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        """Proposals for the walkers of one half from those of the other, and the logarithms of their factors."""
        others = np.concatenate(complement)
        drawn = np.argsort(random.uniform(size=(len(sample), len(others))), axis=1)  # three that differ
        z, first, second = (others[drawn[:, k]] for k in range(3))
        away = sample - z
        distance = np.linalg.norm(away, axis=1)
        along = away / distance[:, None]
        moved = sample + 1.7 * along * np.sum(along * (first - second), axis=1)[:, None]
        stretch = np.log(np.linalg.norm(moved - z, axis=1) / distance)
        return moved, (sample.shape[1] - 1.0) * stretch


class Leap(emcee.moves.RedBlueMove):
    """A walker leaps to a point that does not depend on where it is.

        u' ~ t_10(0, 1),    accepted with probability min(1, p(u') t_10(u) / (p(u) t_10(u')))

    In standard coordinates this is the normal density of `approximation` with heavier tails: where that is nearly
    right, half of the leaps are accepted and walkers forget at once where they were; where it is not, they are refused
    and the other moves do the work. Source: Tierney 1994, sec. 2.3.3 (independence chains).
    """

    def get_proposal(self, sample: np.ndarray, complement: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        """Proposals for the walkers of one half, and the logarithms of their factors."""
        moved = drawn_t(len(sample), sample.shape[1], random)
        return moved, log_t(sample) - log_t(moved)


def moves() -> list[tuple[Any, float]]:
    """Leaps; differential evolution (ter Braak 2006), at times by a whole difference, which leads from mode to mode;
    and snooker."""
    return [(Leap(), 0.7), (emcee.moves.DEMove(), 0.2), (emcee.moves.DEMove(gamma0=1.0), 0.05), (Snooker(), 0.05)]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Walkers after N steps, in standard coordinates u, x = centre + root u, in which the posterior is about normal."""

    points: np.ndarray  # standard coordinates, the start first, shape (N + 1, W, P)
    log_probability: np.ndarray  # shape (N + 1, W)
    accepted: np.ndarray  # moves accepted by each walker, shape (W,)
    random: Any  # state of the random numbers, as numpy's RandomState has it

    @classmethod
    def begin(
        cls, target: LogProbability, size: int, seed: int, settings: SamplingSettings = SamplingSettings()
    ) -> Ensemble:
        """Walkers drawn from a standard normal.

        Far from the mode the density may lie far below the normal one that describes it near the mode. A walker drawn
        there is moved halfway to the mode, again and again until it no longer is.

        Args:
            target: log-probability of standard coordinates, shape (K, P) -> (K,).
            size: P.
            seed: of the random numbers.
            settings: how many walkers.
        """
        random = np.random.RandomState(seed)
        points = random.standard_normal((max(LEAST_WALKERS, settings.walkers_per_coordinate * size), size))
        here = target(points)
        least = float(target(np.zeros((len(points), size)))[0]) - 0.5 * (size + TYPICAL * np.sqrt(2.0 * size))
        for _ in range(HALVINGS):
            astray = here < least
            if not astray.any():
                break
            points = np.where(astray[:, None], 0.5 * points, points)
            here = target(points)
        return cls(points[None], here[None], np.zeros(len(points)), random.get_state())

    @property
    def steps(self) -> int:
        """N."""
        return len(self.points) - 1

    @property
    def acceptance(self) -> float:
        """Share of moves accepted."""
        return float(np.mean(self.accepted)) / max(1, self.steps)

    def advanced(self, target: LogProbability, steps: int) -> Ensemble:
        """The ensemble after some more steps."""
        walkers, size = self.points.shape[1:]
        sampler = emcee.EnsembleSampler(walkers, size, target, moves=moves(), vectorize=True)
        last = emcee.State(self.points[-1], log_prob=self.log_probability[-1], random_state=self.random)
        sampler.run_mcmc(last, steps, skip_initial_state_check=True)
        return replace(
            self,
            points=np.concatenate((self.points, np.asarray(sampler.get_chain()))),
            log_probability=np.concatenate((self.log_probability, np.asarray(sampler.get_log_prob()))),
            accepted=self.accepted + sampler.backend.accepted,
            random=sampler.random_state,
        )


def in_step(work: Callable[[Job, LogProbability], Done], jobs: Sequence[Job], function: LogProbability) -> list[Done]:
    """`work` on each job, one thread each, and a function of points computed for all of them in one call; in order.

    Args:
        work: of a job and a function of points. One job may call it more often than another (emcee 3.1.0 splits an
            ensemble into more parts for some moves than for others): who is done is not waited for.
        jobs: each by itself.
        function: shape (K, P) -> (K,), computed for the points of all jobs that are not done together.
    """
    waiting: dict[int, tuple[np.ndarray, Future[np.ndarray]]] = {}
    busy = set(range(len(jobs)))
    lock = Lock()

    def answer_if_all_wait() -> None:
        if not waiting or len(waiting) < len(busy):
            return
        parts, answers = zip(*(waiting.pop(k) for k in sorted(waiting)), strict=True)
        try:
            values = np.split(function(np.concatenate(parts)), np.cumsum([len(part) for part in parts])[:-1])
        except BaseException as error:
            for answer in answers:
                answer.set_exception(error)
            return
        for answer, value in zip(answers, values, strict=True):
            answer.set_result(value)

    def run(k: int) -> Done:
        def together(points: np.ndarray) -> np.ndarray:
            answer: Future[np.ndarray] = Future()
            with lock:
                waiting[k] = points, answer
                answer_if_all_wait()
            return answer.result()

        try:
            return work(jobs[k], together)
        finally:
            with lock:
                busy.remove(k)
                answer_if_all_wait()

    with ThreadPoolExecutor(len(jobs)) as pool:
        running = [pool.submit(run, k) for k in range(len(jobs))]
    return [each.result() for each in running]
