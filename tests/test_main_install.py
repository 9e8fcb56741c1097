"""What README's main install brings is enough for every verb; what needs an extra says so before any work."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

import etcfit
import folders
from etcfit.errors import how_to_install
from main_install import PROJECT, plain

PACKAGE = Path(etcfit.__file__).parent
TESTS = Path(__file__).parent
# who imports what an extra brings; everything else makes do with the main install
EXTRA_OF = {
    "fleets/": "fleet",
    **{f"importing/formats/{name}.py": "import" for name in ("mcap", "mdf", "parquet", "tdms")},
}
NOTEBOOK = ("api/progress.py", "IPython")  # imported inside a notebook only, which has it
INSEPARABLE = {"jaxlib": "jax", "markupsafe": "jinja2", "dask": "distributed"}  # never one without the other


def names(requirements: list[str]) -> set[str]:
    return {plain(Requirement(each).name) for each in requirements}


def foreign_imports(file: Path) -> set[str]:
    """First names of the modules that a file imports and that are neither Python's nor ours."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
    return found - sys.stdlib_module_names - {"etcfit"}


def test_every_library_that_is_imported_is_declared_where_it_is_needed() -> None:
    providers = metadata.packages_distributions()
    main = names(PROJECT["dependencies"])
    missing = []
    for file in sorted(PACKAGE.rglob("*.py")):
        place = file.relative_to(PACKAGE).as_posix()
        extra = next((extra for start, extra in EXTRA_OF.items() if place.startswith(start)), None)
        declared = main | names(PROJECT["optional-dependencies"].get(extra, []))
        for module in foreign_imports(file):
            brought_by = providers.get(INSEPARABLE.get(module, module), [])
            if not {plain(each) for each in brought_by} & declared:
                missing.append((place, module))
    assert missing == [NOTEBOOK]


def test_no_extra_repeats_what_the_main_install_brings() -> None:
    main = names(PROJECT["dependencies"])
    assert {extra: names(needs) & main for extra, needs in PROJECT["optional-dependencies"].items()} == {
        extra: set() for extra in PROJECT["optional-dependencies"]
    }


def invoked(where: Path, *commands: str, without: str = "") -> list[dict[str, Any]]:
    """Commands in a process that sees the main install alone."""
    program = f"""
import json, sys
import main_install
main_install.hide_the_rest(*{without.split()!r})
print(json.dumps(main_install.invoke({[each.split() for each in commands]!r})))
"""
    paths = os.pathsep.join([str(TESTS), str(PACKAGE.parent)])
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=where, capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": paths, "TERM": "dumb", "MPLBACKEND": "Agg"}, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


NEEDS_EXTRA = {
    "fleet line --out r": ("fleet", "distributed"),
    "fleet memory://line --out r": ("fleet", "distributed"),
    "fleet report run": ("fleet", "pyarrow"),
    "design run --parts run": ("fleet", "pyarrow"),
    "design run --fleet": ("fleet", "pyarrow"),
    "import bad.csv a.mf4 --to m": ("import", "asammdf"),
    "import bad.csv a.tdms --to m": ("import", "nptdms"),
    "import bad.csv a.mcap --to m": ("import", "mcap"),
    "import bad.csv a.parquet --to m": ("import", "pyarrow"),
}


def test_what_needs_an_extra_says_which_before_any_work_and_a_posterior_needs_none(tmp_path: Path) -> None:
    for name in ("a.mf4", "a.tdms", "a.mcap", "a.parquet"):
        (tmp_path / name).touch()
    (tmp_path / "bad.csv").write_text("nothing that could be read")  # is told of first, once anything is read
    (tmp_path / "line").mkdir()
    (tmp_path / "run").mkdir()
    before = sorted(tmp_path.rglob("*"))
    *ended, sampled = invoked(tmp_path, *(f"{words} --quiet" for words in NEEDS_EXTRA), "sample run -q")
    for (extra, library), done in zip(NEEDS_EXTRA.values(), ended, strict=True):
        assert (done["status"], done["out"], done["raised"]) == (2, "", "")
        assert f"needs the library {library}, which is not installed" in done["err"]
        assert how_to_install(extra) in done["err"]
        assert len(done["err"].splitlines()) == 1
    assert "holds no finished `etcfit fit`" in sampled["err"]  # a fit is the second thing that it looks for
    assert sorted(tmp_path.rglob("*")) == before


def test_what_the_posterior_is_written_with_is_tried_before_anything_is_sampled_or_fitted(tmp_path: Path) -> None:
    folders.write(tmp_path / "rig", folders.good())
    (tmp_path / "run").mkdir()
    ended = invoked(tmp_path, "sample run -q", "run rig --out new -q", without="h5py")
    for done in ended:
        assert (done["status"], done["out"], done["raised"]) == (2, "", "")
        assert "posterior.nc cannot be written here" in done["err"]
        assert "h5py" in done["err"]
    assert not (tmp_path / "new").exists()
