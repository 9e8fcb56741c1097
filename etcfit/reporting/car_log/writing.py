"""What `etcfit drive --out RUN` leaves there: drive.json, drive.html and pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...car_log import Study, record_next
from ...files import held, plain, write_json
from ...rig.base import RigConfig
from .page import write_page
from .pictures import draw, draw_answers

_PARTS = ("usage", "spectrum", "tracking", "steps", "cycle", "duty")


def write_drive(run: Path, config: RigConfig, studies: Sequence[Study], report: Callable[[str, float], None]) -> None:
    """RUN/drive.json, RUN/drive.html and RUN/pictures/drive."""
    lacks = record_next([each.log for each in studies])
    content = {"rig": config.name, "synthetic": config.synthetic, "logs": [_json(each) for each in studies],
               "record_next": plain(lacks)}  # fmt: skip
    from .. import style

    with held(run), style.drawing():
        write_json(run / "drive.json", "drive", content)
        drawn = []
        for k, each in enumerate(studies):
            report(f"drawing {each.log.name}", k / len(studies))
            drawn.append(_draw(run / "pictures" / "drive", each, config.synthetic))
        write_page(run / "drive.html", config, studies, lacks, drawn)


def _draw(folder: Path, each: Study, synthetic: bool) -> list[Path]:
    from .. import style

    stem, answers = Path(each.log.name).stem, draw_answers(each, synthetic)
    style.save(draw(each, synthetic), folder / f"{stem}.png")
    if answers is None:
        return [folder / f"{stem}.png"]
    style.save(answers, folder / f"{stem}_answers.png")
    return [folder / f"{stem}_answers.png", folder / f"{stem}.png"]


def _json(each: Study) -> dict[str, Any]:
    """One log; what is infinite becomes null, as a settling that never comes."""
    pair, verdict = each.sensors, each.verdict
    told = {"word": verdict.word, "says": verdict.says, "judgements": verdict.judgements}
    return plain(
        {"file": each.log.name, "seconds": np.ptp(each.log.position.time), "columns": each.log.columns}
        | {k: getattr(each, k) for k in _PARTS}
        | {"cycle_says": "" if each.cycle is None else each.cycle.says}
        | {"sensors": None if pair is None else plain(pair) | {"findings": pair.findings, "table": pair.table}}
        | {"verdict": told}
    )
