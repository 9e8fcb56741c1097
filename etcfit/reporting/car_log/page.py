"""The page of some logs: one file without scripts, for a screen of any width."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...car_log import Study
from ...car_log.coverage import Lack
from ...car_log.study import verdict
from ...files import whole
from ...rig.base import RigConfig
from ..html import environment
from ..page.pictures import carried
from .tables import in_a_word, says_of, tables_of


def write_page(
    path: Path, config: RigConfig, studies: Sequence[Study], lacks: Sequence[Lack], drawn: Sequence[Sequence[Path]]
) -> None:
    """Write drive.html.

    Args:
        path: of the page.
        config: of the rig, or what stands for it.
        studies: a log each.
        lacks: what to record next.
        drawn: pictures of each log.
    """
    made = environment(("etcfit.reporting.car_log", "template"), ("etcfit.reporting.page", "template"))
    logs = [
        {
            "name": each.log.name,
            "seconds": float(np.ptp(each.log.position.time)),
            "word": in_a_word(each.verdict),
            "bad": each.verdict.word == "not good",
            "says": each.verdict.says,
            "columns": each.log.columns,
            "hint": each.log.hint,
            "findings": says_of(each),
            "tables": tables_of(each),
            "pictures": [carried(picture, "drive") for picture in pictures],
        }
        for each, pictures in zip(studies, drawn, strict=True)
    ]
    text = made.get_template("log.html").render(
        rig=config.name, synthetic=config.synthetic, logs=logs,
        changed=verdict(*studies) if len(studies) == 2 else "",
        to_record=[f"{lack.record}. It tells {lack.why}." for lack in lacks],
    )  # fmt: skip
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")
