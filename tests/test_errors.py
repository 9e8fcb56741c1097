"""What is missing is named with what brings it, by a command that works as it stands."""

from __future__ import annotations

import shlex
import sys
from importlib import metadata
from pathlib import Path

import pytest

from etcfit.errors import UsageError, first_names, how_to_install, require_extra

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("extra", ["fleet", "import"])
def test_how_to_install_has_the_requirements_of_the_package_and_this_very_python(extra: str) -> None:
    says = how_to_install(extra)
    command = shlex.split(says.removeprefix("Install them: ").partition(", or, ")[0])
    assert command[:4] == [sys.executable, "-m", "pip", "install"]
    every = metadata.requires("etcfit") or []
    assert command[4:] == [each.partition(";")[0].strip() for each in every if each.endswith(f"extra == '{extra}'")]
    assert f"-m pip install '.[{extra}]'." in says


def test_where_the_package_is_not_installed_its_source_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(name: str) -> list[str]:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.requires", nothing)
    assert how_to_install("fleet").startswith("Install them: in the folder of etcfit's source")


def test_only_what_is_missing_is_said_to_be() -> None:
    with pytest.raises(UsageError, match=r"^A fleet needs the library no_such_library, .*\. Install them: "):
        require_extra("fleet", "A fleet", "json", "no_such_library")
    require_extra("fleet", "A fleet", "json")


def test_no_message_names_a_package_that_no_index_has() -> None:
    files = [*(ROOT / "etcfit").rglob("*.py"), *(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    assert [file.name for file in files if "etcfit[" in file.read_text("utf-8")] == []


@pytest.mark.parametrize(("count", "said"), [(0, ""), (3, "0, 1, 2"), (4, "0, 1, 2 and 1 more"),
                                             (2003, "0, 1, 2 and 2,000 more")])  # fmt: skip
def test_the_first_names_and_how_many_more(count: int, said: str) -> None:
    assert first_names([str(k) for k in range(count)], 3) == said
