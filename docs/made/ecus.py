"""The table of engine computers, made from their registry."""

from __future__ import annotations


def table() -> str:
    """One row a make: what its source fixes, what it can put ahead, tables of gains, what is assumed, the source."""
    from etcfit import ECUS

    rows = ["| `--ecu` | make | its source fixes | ahead | over the supply | assumed | source |",
            "| --- | --- | --- | --- | --- | --- | --- |"]  # fmt: skip
    for make in ECUS.values():
        fixed = ", ".join(f"{name} {value:g}" for name, value in make.fixes.items()) or "nothing"
        assumed = "; ".join(make.assumed) or "nothing"
        ahead = ", ".join(term.value for term in make.terms) or "nothing"
        over = make.scheduling.value
        rows.append(f"| `{make.name}` | {make.title} | {fixed} | {ahead} | {over} | {assumed} | {make.source} |")
    return "\n".join(rows)
