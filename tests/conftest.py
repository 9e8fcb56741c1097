"""Every test runs in float64, and an array that broadcasts by accident is an error."""

from __future__ import annotations

import gc
import importlib.util
import os
import sys
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from etcfit.diagnosis.findings import Diagnosis
    from etcfit.estimation.fitted_model import Fitted
    from etcfit.estimation.result import FitResult
    from etcfit.rig.base import Rig

os.environ.setdefault("JAX_ENABLE_X64", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a worker a core: threads of small products only wait
gc.set_threshold(100_000, 50, 50)  # as the command line: tracing makes many objects and no garbage, a sixth of the time

if importlib.util.find_spec("jax"):
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_numpy_rank_promotion", "raise")

CHECKED = os.environ.get("ETCFIT_TYPES") != "unchecked"

if CHECKED and importlib.util.find_spec("jaxtyping") and importlib.util.find_spec("beartype"):
    from jaxtyping import install_import_hook

    # shapes and types of every call into these rooms are checked; users never pay for it, nor do the slow tests of CI:
    # a residual takes several times as long, and the quick tests have just called the same functions checked
    install_import_hook(["etcfit.problem", "etcfit.model"], "beartype.beartype")


def pytest_configure(config: pytest.Config) -> None:
    """What a test compiles goes neither into nor out of the user's own folder; the other process and the next run find
    it in pytest's (`--cache-clear` forgets it), as long as no file of the package and no flag has changed."""
    assert config.cache is not None
    os.environ["ETCFIT_CACHE"] = str(config.cache.mkdir("etcfit"))
    if importlib.util.find_spec("jax"):
        from etcfit.backend import use_compilation_cache
        from etcfit.kernels.kept import trace_always

        use_compilation_cache()
        trace_always()


_tests = count(1)


def pytest_runtest_logfinish() -> None:
    """Let go of what XLA compiled once that is much: a program of the reference holds ten to two hundred mappings of
    memory, and Linux ends a process that wants more than 65,530. What a later test needs again comes from the disk.
    To list ten thousand takes 8 ms: only every tenth test does."""
    if next(_tests) % 10:
        return
    mappings = Path("/proc/self/maps")
    if "jax" in sys.modules and mappings.exists() and mappings.read_bytes().count(b"\n") > 12_000:
        jax.clear_caches()


@pytest.fixture(scope="session")
def measured() -> Path:
    """The folder of other people's measured data; not part of the project, so a test may have to do without."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "measured"
    folder = Path(os.environ.get("ETCFIT_DATA", beside))
    if not (folder / "kassel_throttle").is_dir():
        pytest.skip("no copy of the measured data here (ETCFIT_DATA names none): real data sets are left out")
    return folder


@pytest.fixture
def drawn_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stripes in place of each picture of a run folder, for tests that look into none."""
    import runs

    monkeypatch.setattr("etcfit.reporting.drawing.at_hand", None)  # nobody helps
    monkeypatch.setattr("etcfit.reporting.drawing.CORES", 1)
    monkeypatch.setattr("etcfit.reporting.drawing.draw_one", lambda path, draw: runs.picture(path, (8, 8)))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """One trace of each test, its results invented."""
    import results

    return results.rig(tmp_path_factory.mktemp("rig"))


@pytest.fixture(scope="module")
def fit(rig: Rig) -> FitResult:
    """Of that rig, invented too: nominal values, every coordinate known to 0.02."""
    import results

    return results.result(rig)


@pytest.fixture(scope="module")
def fitted(fit: FitResult) -> Fitted:
    return fit.fitted()


@pytest.fixture(scope="module")
def found(rig: Rig) -> Diagnosis:
    """Of that rig, invented too."""
    import diagnoses

    return diagnoses.diagnosis(rig)
