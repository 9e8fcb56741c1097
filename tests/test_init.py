"""The facade: cheap to import, and every public name is where it says."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import os
import pkgutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import etcfit

VERBS = ["advise", "check", "design", "diagnose", "drive", "export", "fetch", "fit", "fleet", "load", "plan", "reduce",
         "report", "run", "sample"]  # fmt: skip


def test_a_public_name_is_its_modules_own() -> None:
    modules = {name: importlib.import_module(f"etcfit.{place}") for name, place in etcfit.MODULE_OF.items()}
    assert [name for name, module in modules.items() if getattr(etcfit, name) is not getattr(module, name)] == []


def test_no_public_name_hides_a_module() -> None:
    # importing etcfit.estimation.joint_fit would put the module where the name had been
    assert not [name for name in etcfit.MODULE_OF if importlib.util.find_spec(f"etcfit.{name}")]


def test_a_verb_stays_a_function_whatever_is_imported() -> None:
    for module in pkgutil.walk_packages(etcfit.__path__, "etcfit."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    assert [verb for verb in VERBS if not inspect.isfunction(getattr(etcfit, verb))] == []
    assert set(VERBS) <= set(dir(etcfit))


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="throtle"):
        getattr(etcfit, "throtle")  # noqa: B009


def fresh(program: str, **environment: str) -> str:
    """What a program prints in a process of its own."""
    theirs = ("JAX_ENABLE_X64", "TF_CPP_MIN_LOG_LEVEL")  # set by whoever imported JAX here
    ours = {name: value for name, value in os.environ.items() if name not in theirs} | environment
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=ours)
    assert done.stderr == ""
    return done.stdout.strip()


HEAVY = "print(sorted({'jax', 'pandas', 'matplotlib', 'numpy', 'rich', 'IPython'} & set(sys.modules)))"


def test_importing_the_package_asks_for_float64_and_leaves_jax_alone() -> None:
    assert fresh("import etcfit, os; print(os.environ['JAX_ENABLE_X64'])") == "1"
    assert fresh(f"import etcfit, sys; {HEAVY}") == "[]"


LOGGED = "import os; print(os.environ['TF_CPP_MIN_LOG_LEVEL'])"


@pytest.mark.slow
def test_the_log_of_xla_is_not_for_the_terminal_unless_the_user_says_so() -> None:
    assert fresh(f"import etcfit; etcfit.Fit; {LOGGED}") == "3"
    assert fresh(f"import etcfit; {LOGGED}", TF_CPP_MIN_LOG_LEVEL="0") == "0"


def test_looking_at_the_verbs_imports_nothing_heavy() -> None:
    assert fresh(f"import etcfit, sys; [getattr(etcfit, v) for v in {VERBS}]; dir(etcfit); {HEAVY}") == "[]"


# what a command loads that computes nothing but its own answer, and what stays away that is not needed for it. One
# process takes them up in this order: what one has loaded stays loaded for those behind it
FAR = {"emcee", "matplotlib", "pandas", "scipy.integrate", "scipy.io", "scipy.signal", "scipy.stats", "xarray"}
LIGHT: dict[str, tuple[str, set[str]]] = {
    "a named run folder": (
        "from etcfit.stages import opened; opened(__import__('pathlib').Path('measurements'))",
        FAR | {"jax"},
    ),
    "import": (
        "import etcfit.importing.answers, etcfit.reporting.closing, etcfit.reporting.blocks",
        FAR | {"equinox", "optimistix", "scipy"},
    ),
    "fit": (
        "import etcfit.rig.reader, etcfit.estimation.joint_fit, etcfit.api.fit, etcfit.api.work, "
        "etcfit.reporting.closing.model, etcfit.run_folder.state",
        FAR | {"etcfit.diagnosis.course", "etcfit.reporting.page.render", "scipy.optimize"},
    ),
    "report": ("import etcfit.reporting.page, etcfit.reporting.closing.model, etcfit.api.work", FAR),
    "export": ("import etcfit.exporting, etcfit.api.work, etcfit.reporting.closing.control", FAR),
    "Python, without a picture": ("import etcfit; etcfit.Fit; etcfit.Diagnosed; etcfit.Sampled", {"matplotlib"}),
    "diagnose": ("import etcfit.diagnosis, etcfit.reporting.diagnosis, etcfit.api.work", FAR - {"matplotlib"}),
}
CHECK = (
    "import etcfit.experiment.check, etcfit.api.measurements, etcfit.reporting.closing; "
    "from etcfit.rig.reader import read_folder; from etcfit.rig.paper_readings import read_graphs; "
    "read_graphs(read_folder('measurements/bench_twin'))"
)


def loaded(commands: dict[str, tuple[str, set[str]]]) -> dict[str, list[str]]:
    """What is there after each command, one after the other, of what should not be."""
    show = "print(json.dumps(sorted({far} & set(sys.modules))))"
    lines = [f"{program}; {show.format(far=far)}" for program, far in commands.values()]
    told = fresh("\n".join(["import json, sys", *lines])).splitlines()
    return dict(zip(commands, map(json.loads, told), strict=True))


def test_a_command_imports_nothing_heavy_that_its_answer_does_not_need() -> None:
    assert loaded(LIGHT) == {command: [] for command in LIGHT}
    # a rise of current is fitted by SciPy's optimiser, which a fit does without
    assert loaded({"check": (CHECK, FAR | {"lineax", "optimistix"})}) == {"check": []}


@pytest.mark.slow
def test_compiled_models_are_kept_once_something_is_computed_and_not_before(tmp_path: Path) -> None:
    show = "from etcfit import backend; print(backend.compiled_folder())"
    begin = "import jax, etcfit; from etcfit.api.progress import working; "
    work = "working().__enter__(); "
    assert fresh(f"{begin}{show}", ETCFIT_CACHE=str(tmp_path)) == "None"
    assert fresh(f"{begin}{work}{show}", ETCFIT_CACHE=str(tmp_path)) == str(tmp_path / "compiled")
    own = f"jax.config.update('jax_compilation_cache_dir', '{tmp_path}/own'); "
    show = "print(jax.config.jax_compilation_cache_dir)"
    assert fresh(f"{begin}{own}{work}{show}", ETCFIT_CACHE=str(tmp_path)) == f"{tmp_path}/own"


def test_type_checkers_are_told_that_the_package_is_typed() -> None:
    assert (Path(etcfit.__file__).parent / "py.typed").is_file()
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"] == ["etcfit"]
