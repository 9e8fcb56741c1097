"""The verbs of the command line, and the options of each, as the command line declares them.

They are read off the signatures, so neither the parser behind the command line nor its version matters.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

METAVARS = {int: "N", float: "X", str: "TEXT", Path: "FOLDER"}


def options(name: str) -> str:
    """A table of one command's arguments and options."""
    function = spread(commands()[name])
    hints = get_type_hints(function, include_extras=True)
    rows = ["| argument or option | default | meaning |", "| --- | --- | --- |"]
    rows += [row(each, hints[each.name]) for each in inspect.signature(function).parameters.values()]
    return "\n".join([*rows, "| `-h`, `--help` |  | Show this and stop. |"])


def verbs() -> str:
    """Every command in a line, with what it must be given."""
    rows = ["| command | what it does |", "| --- | --- |"]
    for name, function in commands().items():
        first = (inspect.getdoc(inspect.unwrap(function)) or "").partition("\n")[0]
        rows.append(f"| `etcfit {' '.join([name, *required(function)]).replace('|', ' or ')}` | {first} |")
    return "\n".join(rows)


def required(function: Any) -> Iterator[str]:
    """The arguments and options without which a command does nothing."""
    function = spread(function)
    hints = get_type_hints(function, include_extras=True)
    for each in inspect.signature(function).parameters.values():
        kinds, info = described(hints[each.name])
        metavar = info.metavar or METAVARS.get(kinds[0], each.name.upper())
        if type(info).__name__ == "ArgumentInfo":
            yield metavar
        elif each.default in (inspect.Parameter.empty, ...):
            yield f"--{each.name.replace('_', '-')} {metavar}"


def spread(function: Any) -> Any:
    """The function as typer sees it, whose options are its arguments."""
    return inspect.unwrap(function, stop=lambda each: hasattr(each, "__signature__"))


def commands() -> dict[str, Any]:
    """The function of each command, by name."""
    from etcfit.cli import app

    return {c.name or c.callback.__name__: c.callback for c in app.registered_commands if c.callback}


def row(parameter: inspect.Parameter, hint: Any) -> str:
    kinds, info = described(hint)
    help_ = (info.help or "").replace("|", "\\|")
    if type(info).__name__ == "ArgumentInfo":
        metavar = (info.metavar or parameter.name.upper()).replace("|", "` or `")
        return f"| `{metavar}` | required | {help_} |"
    value = "" if kinds == (bool,) else " " + (info.metavar or " ".join(METAVARS[kind] for kind in kinds))
    # inside Annotated the first name stands where a default would
    names = [name for name in (info.default, *(info.param_decls or ())) if isinstance(name, str)]
    shown = ", ".join(f"`{name}{value}`" for name in names or [f"--{parameter.name.replace('_', '-')}"])
    return f"| {shown} | {default_of(parameter, info)} | {help_} |"


def described(hint: Any) -> tuple[tuple[Any, ...], Any]:
    """Types and option of Annotated[type, option]; `X | None` counts as X, a tuple as its entries."""
    annotated, info = get_args(hint)[:2]
    kinds = [kind for kind in get_args(annotated) if kind is not type(None)] or [annotated]
    return tuple(inner for kind in kinds for inner in (get_args(kind) or (kind,))), info


def default_of(parameter: inspect.Parameter, info: Any) -> str:
    """Empty where there is none: the option's text then says what happens without it."""
    value = parameter.default
    if isinstance(info.show_default, str):
        return info.show_default
    if value in (inspect.Parameter.empty, ...):
        return "required"
    if value is None or isinstance(value, bool):
        return ""
    return f"`{' '.join(map(str, value)) if isinstance(value, tuple) else value}`"
