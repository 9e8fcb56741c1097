"""The catalogues of effects and the table of symbols, made from their registries."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import Any

NEEDS = {
    "circuit": "an electrical side (voltage or duty drives the motor)",
    "current": "the current",
    "position": "the plate's angle",
    "gear": "a gear ratio",
    "bridge": "settled speeds, which hardly grow with the voltage (`etcfit check` tells of it)",
}


def catalogue() -> str:
    """Every registered effect: those of Eqs. 1-2 first, then those that a diagnosis may add."""
    from etcfit import EFFECTS

    always = [effect for effect in EFFECTS if effect.off is None]
    candidates = [effect for effect in EFFECTS if effect.off is not None]
    parts = [
        "## Equations 1-2: always in the model",
        "",
        *(section(effect) for effect in always),
        f"## Candidates: {len(candidates)} effects beyond Equations 1-2",
        "",
        "| effect | its amplitude is 0 when it is off | shown best by |",
        "| --- | --- | --- |",
        *(f"| [`{e.name}`](#{e.name}) | {off_names(e)} | {e.told_by} |" for e in candidates),
        "",
        *(section(effect) for effect in candidates),
    ]
    return "\n".join(parts)


def of_the_rig() -> str:
    """Every registered family of effects of the rig."""
    from etcfit.model.rig_effects import RIG_EFFECTS, Place

    place = {"series_resistance": Place("inductance"), "time_scale": Place("response"),
             "edge_phase": Place("response"), "channel_drift": Place("response", "torque")}  # fmt: skip
    usual = {"rig": Place(), "trace": Place.named("response/3.csv")}
    parts = []
    for family in RIG_EFFECTS:
        at = place.get(family.kind, usual.get(family.scope, Place("response", "current")))
        parts += [
            f"### `{family.kind}` {{ #{family.kind} }}",
            "",
            body(family),
            "",
            f"- **Written as:** `{family.at(at).name}`; parameters {off_names(family.at(at)) or 'none'}.",
            f"- **Shown best by:** {plain(family.told_by)}.",
            "",
        ]
    return "\n".join(parts)


def off_names(effect: Any) -> str:
    """Its amplitudes: what is 0 where the effect is off."""
    return ", ".join(f"`{symbol}`" for symbol in effect.off or ())


def section(effect: Any) -> str:
    """Name, formula, source, parameters, and what shows it."""
    lines = [f"### `{effect.name}` {{ #{effect.name} }}", "", body(effect), ""]
    if declared := parameters_of(effect):
        lines += ["| symbol | unit | meaning | source |", "| --- | --- | --- | --- |"]
        lines += [f"| `{s}` | `{unit}` | {plain(means)} | {plain(source)} |" for s, unit, means, source in declared]
        lines += [""]
    if effect.off is not None:
        off = ", ".join(f"{symbol} = {value:g}" for symbol, value in effect.off.items())
        needs = " and ".join(NEEDS[need] for need in effect.needs) or "nothing in particular"
        lines += [
            f"- **Shown best by:** {plain(effect.told_by)}.",
            f"- **Must have been logged:** {needs}.",
            f"- **Off at:** `{off}`. **Formula taken as inexact by:** {100.0 * effect.inexact:g} %.",
            "",
        ]
    return "\n".join(lines)


def body(effect: Any) -> str:
    """The docstring: what reads as a formula is set as one."""
    paragraphs = re.split(r"\n\s*\n", inspect.getdoc(effect) or "")
    return "\n\n".join(formula(p) if is_formula(p) else plain(p) for p in paragraphs)


def is_formula(paragraph: str) -> bool:
    """Indented, or an equation that is not the middle of a sentence about the effect's source."""
    first = paragraph.split("\n")[0]
    return paragraph.startswith("    ") or (" = " in first and not first.startswith(("Source", "A ", "The ")))


def formula(paragraph: str) -> str:
    return "```text\n" + inspect.cleandoc(paragraph) + "\n```"


def plain(text: str) -> str:
    """Text in which no character is markup."""
    pieces = text.split("`")  # every second one is code already
    pieces[::2] = [re.sub(r"([_*|\[\]])", r"\\\1", piece.replace("<", "&lt;")) for piece in pieces[::2]]
    return "`".join(pieces)


def parameters_of(effect: Any) -> list[tuple[str, str, str, str]]:
    """Symbol, unit, meaning and source of each parameter that an effect declares."""
    declared = [(f.name, f.metadata["parameter"]) for f in dataclasses.fields(effect) if "parameter" in f.metadata]
    return [(name, unit, meaning, source) for name, (unit, _, _, meaning, source) in declared]


def symbols() -> str:
    """Every parameter of every effect, in the order of the registry."""
    from etcfit import EFFECTS

    rows = ["| symbol | SI unit | meaning | effect |", "| --- | --- | --- | --- |"]
    for effect in EFFECTS:
        for symbol, unit, meaning, _ in parameters_of(effect):
            rows.append(f"| `{symbol}` | `{unit}` | {plain(meaning)} | [`{effect.name}`](effects.md#{effect.name}) |")
    return "\n".join(rows)
