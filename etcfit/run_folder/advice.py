"""advice.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..experiment.advice import Advice, Option
from ..files import held, plain, write_json
from .fit import versions


def save_advice(run: Path, advice: Advice) -> None:
    """RUN/advice.json; it is of no stage, so it has no entry in RUN/run.json."""
    with held(run):
        write_json(run / "advice.json", "advice", advice_json(advice))


def advice_json(advice: Advice) -> dict[str, Any]:
    """The object of advice.json, see docs/formats.md."""
    return plain({
        "rig": advice.rig.config.name,
        "synthetic": advice.rig.config.synthetic,
        "stderr_now": dict(zip(advice.symbols, advice.sd.tolist(), strict=True)),
        "options": [_option(option, advice.symbols) for option in advice.options],
        "not_judged": dict(advice.not_judged),
        "settings": advice.settings,
        "versions": versions(),
    })  # fmt: skip


def _option(option: Option, symbols: tuple[str, ...]) -> dict[str, Any]:
    pair = option.separates
    return {
        "test": option.test,
        "again": option.again,
        "how": option.says,
        "remark": option.remark or None,
        "mean": option.mean,
        "widths": dict(zip(symbols, option.shrinks.tolist(), strict=True)),
        "separates": pair and {"symbols": pair.symbols, "correlation": pair.before, "correlation_after": pair.after},
    }
