"""The two-stage estimate against a full hierarchical posterior, sampled by NumPyro, on the same units.

    theta_u ~ N(mu, Omega), estimate_u ~ N(theta_u, F_u^-1);   flat mu, half-normal sd five times the spread, LKJ(1)

What may differ: the posterior mean of a mean is the restricted likelihood's to within how much the weights change over
the posterior of the spread, a fraction of a standard error: 0.25 of it is allowed. A posterior median of an sd lies
above the restricted maximum, as its likelihood has its longer tail there: for 20 units, 19 degrees of freedom,
by 1 / (3 * 19) + 1 / 19 of it or so, and more with weak units; half a posterior standard deviation is allowed where
the interval leaves nought out. Where it does not, a median says nothing of a density that may be highest at nought:
there the restricted maximum must be near the posterior's highest density, which a histogram of twelve bins tells to
half a bin, hence three quarters of a standard deviation. Both ends of the interval agree within one posterior standard
deviation. The Monte Carlo error, 3000 draws, is below a tenth of each.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fleet_statistics import Design, draw
from etcfit.fleets.statistics.population import population


def modes(draws: np.ndarray) -> np.ndarray:
    """Middle of the fullest of twelve bins from nought, of each column."""
    out = []
    for column in draws.T:
        count, edges = np.histogram(column, bins=12, range=(0.0, float(np.quantile(column, 0.99))))
        k = int(np.argmax(count))
        out.append(0.5 * (edges[k] + edges[k + 1]))
    return np.array(out)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # NumPyro's and its dependencies', which are not ours
@pytest.mark.parametrize("weak", [0.4, 1.0])
def test_mean_and_spread_agree_with_the_full_posterior(weak: float) -> None:
    jax, numpyro = pytest.importorskip("jax"), pytest.importorskip("numpyro")
    import jax.numpy as jnp
    from numpyro import distributions as dist
    from numpyro.infer import MCMC, NUTS

    drawn = draw(Design(20, 3, weak), 31)
    scale = drawn.sd
    y = drawn.stack.estimate / scale
    errors = np.linalg.inv(drawn.stack.information * np.outer(scale, scale))

    def model() -> None:
        mu = numpyro.sample("mu", dist.Normal(jnp.asarray(drawn.mean / scale), 100.0).to_event(1))
        sd = numpyro.sample("sd", dist.HalfNormal(jnp.full(3, 5.0)).to_event(1))
        rows = numpyro.sample("rows", dist.LKJCholesky(3, 1.0))
        root = sd[:, None] * rows
        # theta integrated out: the same posterior of mu and Omega, without its funnel
        covariance = (root @ root.T)[None, :, :] + jnp.asarray(errors)
        numpyro.sample("y", dist.MultivariateNormal(mu[None, :], covariance).to_event(1), obs=jnp.asarray(y))

    chain = MCMC(NUTS(model, target_accept_prob=0.9), num_warmup=700, num_samples=3000, progress_bar=False)
    with jax.numpy_rank_promotion("allow"):
        chain.run(jax.random.PRNGKey(3))
        draws = {k: np.asarray(v) for k, v in chain.get_samples().items()}
    found = population(drawn.stack)

    stderr = draws["mu"].std(axis=0)
    assert np.all(np.abs(found.mean / scale - draws["mu"].mean(axis=0)) < 0.25 * stderr)
    np.testing.assert_allclose(found.mean_stderr / scale, stderr, rtol=0.3)
    spread = draws["sd"].std(axis=0)
    middle = np.where(found.sd_interval[:, 0] > 0.0, np.median(draws["sd"], axis=0), modes(draws["sd"]))
    allowed = np.where(found.sd_interval[:, 0] > 0.0, 0.5, 0.75) * spread
    assert np.all(np.abs(found.sd / scale - middle) < allowed)
    bounds = np.quantile(draws["sd"], [0.025, 0.975], axis=0).T
    assert np.all(np.abs(found.sd_interval / scale[:, None] - bounds) < spread[:, None])
