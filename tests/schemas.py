"""What the package writes, held against the schema of its kind."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, ValidationError

from etcfit.files import write_json


def validator(kind: str) -> Draft202012Validator:
    schema = files("etcfit.run_folder") / "schemas" / f"{kind}.schema.json"
    return Draft202012Validator(json.loads(schema.read_text(encoding="utf-8")))


def assert_refused(kind: str, *wrong: Any) -> None:
    for each in wrong:
        with pytest.raises(ValidationError):
            validator(kind).validate(each)


def read_valid(path: Path) -> Any:
    """A file of a run folder, taken by the schema that its name says."""
    written = json.loads(path.read_text(encoding="utf-8"))
    validator(path.stem).validate(written)
    return written


def written_valid(folder: Path, kind: str, content: Any) -> Any:
    """The same of content that is written there first."""
    write_json(folder / f"{kind}.json", kind, content)
    return read_valid(folder / f"{kind}.json")
