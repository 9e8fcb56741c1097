"""Arguments of the verbs, checked against their annotations before any work.

Classes are compared by name, so that no heavy module is imported for the check.
"""

from __future__ import annotations

import functools
import inspect
import re
import warnings
from collections.abc import Callable
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_MEANS = {"Folder": ("str", "Path"), "None": ("NoneType",)}
_IN_WORDS = {"str": "a text", "Path": "a path", "int": "a whole number", "float": "a number", "bool": "True or False",
             "Sequence": "a sequence", "tuple": "a tuple", "Mapping": "a mapping", "None": "None", "Folder": "a path",
             "Rig": "a rig", "Fit": "a fit", "Diagnosed": "a diagnosis", "Sampled": "a posterior",
             "Fleet": "a fleet", "RunFolder": "a path", "Report": "a function"}  # fmt: skip
_ALONE = {"Model", "Literal", "TermNames", "Any"}  # the verb itself checks these


def verb(work: Callable[P, R]) -> Callable[P, R]:
    """Make a function a verb: arguments of a type that its annotation does not name are refused, and a remark on its
    result becomes a warning, unless the caller shows the progress himself.

    Raises:
        TypeError: when the verb is called; it names the argument, the types that it takes and the type that was given.
    """
    signature = inspect.signature(work)

    @functools.wraps(work)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            parameter = signature.parameters[name]
            given = value if parameter.kind is parameter.VAR_KEYWORD else {name: value}
            for each, one in given.items():
                if not fits(one, parameter.annotation):
                    raise TypeError(f"etcfit.{work.__name__} takes {in_words(parameter.annotation)} for `{each}`, not "
                                    f"{type(one).__name__}.")  # fmt: skip
        found = work(*args, **kwargs)
        if (remark := getattr(found, "remark", "")) and not callable(kwargs.get("quiet")):
            warnings.warn(remark, stacklevel=2)
        return found

    return called


def fits(value: Any, annotation: str) -> bool:
    """Whether a value has one of the types that an annotation names; text in brackets does not count."""
    names = _names(annotation)
    if _ALONE & {*names}:
        return True
    if isinstance(value, bool):
        return "bool" in names
    kinds = {name for kind in type(value).__mro__ for name in (kind.__name__,)}
    wanted = {each for name in names for each in _MEANS.get(name, (name,))}
    return (
        bool(kinds & wanted)
        or ("Path" in wanted and hasattr(value, "__fspath__"))
        or ("int" in wanted and isinstance(value, Integral))
        or ("float" in wanted and isinstance(value, Real))
        or ("Sequence" in wanted and isinstance(value, list | tuple))
        or ("Mapping" in wanted and isinstance(value, dict))
        or ("Report" in wanted and callable(value))
    )


def in_words(annotation: str) -> str:
    """The annotation as words for an error: "a rig, a path or None"."""
    *others, last = dict.fromkeys(_IN_WORDS.get(name, name) for name in _names(annotation))
    return f"{', '.join(others)} or {last}" if others else last


def _names(annotation: str) -> list[str]:
    """`Sequence[tuple[str, str]] | None` -> Sequence, None."""
    while (inner := re.sub(r"\[[^\[\]]*\]", "", annotation)) != annotation:
        annotation = inner
    return [name.strip() for name in annotation.split("|")]
