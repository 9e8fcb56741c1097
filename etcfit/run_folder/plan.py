"""plan.json, and the measurement folder that waits for the records."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

from ..errors import MeasurementError
from ..experiment.campaign import Campaign, LoggedColumn, PlannedTest, band, logger
from ..files import plain
from ..rig.config import parse_config
from .fit import versions

_POINTS = 300  # of an expected curve


def plan_json(campaign: Campaign) -> dict[str, Any]:
    """The object of plan.json, see docs/formats.md."""
    s, settings = campaign.setting, campaign.settings
    return plain({
        "rig": campaign.rig.config.name,
        "synthetic": campaign.rig.config.synthetic,
        "model": "fit" if campaign.at_fit else "graph readings",
        "cautions": campaign.cautions,
        "criterion": campaign.criterion.value,
        "limits": {
            "supply_V": s.supply,
            "current_A": settings.current,
            "winding_degC": settings.temperature,
            "position_rad": _room(campaign),
        },
        "winding": {"capacity_J_per_K": campaign.winding.capacity, "cooling_s": campaign.winding.cooling,
                    "fitted": campaign.winding.fitted},
        "stderr": _stderr(campaign.symbols, campaign.now, campaign.expected),
        "seconds": campaign.seconds,
        "tests": [_test(campaign, k, test) for k, test in enumerate(campaign.tests, 1)],
        "left_out": [{"how": how, "why": why} for how, why in campaign.left_out],
        "settings": settings,
        "versions": versions(),
    })  # fmt: skip


def _room(campaign: Campaign) -> list[float]:
    margin = campaign.settings.margin * (campaign.setting.open - campaign.setting.rest)
    return [campaign.setting.rest + margin, campaign.setting.open - margin]


def _stderr(symbols: tuple[str, ...], before: np.ndarray, after: np.ndarray) -> dict[str, Any]:
    return {s: {"now": b, "expected": a} for s, b, a in zip(symbols, before.tolist(), after.tolist(), strict=True)}


def _test(campaign: Campaign, number: int, test: PlannedTest) -> dict[str, Any]:
    plan, played = test.candidate.plan, test.candidate.played
    seen = np.unique(np.linspace(0, plan.time.size - 1, _POINTS).astype(int))
    hot = campaign.settings.ambient + float(test.forecast.warmth.max())
    bands = {name: band(test, campaign.setting, name) for name in test.forecast.shown}
    expected = {
        name: {"value": test.forecast.shown[name][0, seen], "low": low[seen], "high": high[seen]}
        for name, (low, high) in bands.items()
    }
    return {
        "file": test.file,
        "test": plan.test,
        "shape": test.candidate.kind,
        "how": plan.says,
        "remark": campaign.remark(test) or None,
        "seconds": test.candidate.seconds,
        "keeps_off_stops_s": test.candidate.window,
        "play": None if played is None else {
            "csv": f"play/plan_{number}.csv",
            "table": f"play/plan_{number}/plan_{number}.h",
            "sketch": f"play/plan_{number}/plan_{number}.ino",
            "period_s": float(played.time[1] - played.time[0]),
            "supply_V": played.supply,
        },
        "logger": [_column(column) for column in logger(test, campaign)],
        "peaks": {name: [float(v.min()), float(v.max())] for name, v in test.forecast.shown.items()}
        | {"winding_degC": hot},
        "pause_s": test.pause,
        "expected": {"time": plan.time[seen], **expected},
        "stderr": _stderr(campaign.symbols, test.before, test.after),
    }  # fmt: skip


def _column(column: LoggedColumn) -> dict[str, Any]:
    return {"header": column.header, "low": column.low, "high": column.high, "resolution": column.resolution}


def waiting_folder(campaign: Campaign) -> dict[str, str]:
    """Path inside PLAN -> text: rig.toml and, for each rig test, what to record; readable once a record is there."""
    files = {"measurements/rig.toml": rig_toml(campaign)}
    for test in campaign.tests:
        place = f"measurements/{test.candidate.plan.test}/README.txt"
        head = ",".join(column.header for column in logger(test, campaign))
        text = f"{test.file.rpartition('/')[2]}: {test.candidate.plan.says}. Header: {head}\n"
        files[place] = files.get(place, "") + text
    return files


def rig_toml(campaign: Campaign) -> str:
    """The rig's own rig.toml without its [holdout], whose files are not in this folder."""
    names = "".join(f"#   {test.file}\n" for test in campaign.tests)
    synthetic = "# SYNTHETIC: planned from simulated data\n" if campaign.rig.config.synthetic else ""
    head = (f"# Of the tests that `etcfit plan` chose. Record them, with the headers of each README.txt, as\n{names}"
            f"# and read them with `etcfit check` on this folder. To fit them with all that is there, copy them into\n"
            f"# {' '.join(campaign.rig.folder.split())}\n{synthetic}\n")  # fmt: skip
    own = campaign.rig.toml or _minimal(campaign)
    text = head + re.sub(r"(?ms)^\[holdout\].*?(?=^\[|\Z)", "", own)
    try:
        parse_config(text, "rig.toml")
    except MeasurementError:  # a [holdout] written otherwise
        text = head + _minimal(campaign)
    return text


def _minimal(campaign: Campaign) -> str:
    """Nameplate and sensor of a rig whose rig.toml is not at hand."""
    config, tps = campaign.rig.config, campaign.rig.config.tps
    low, high = (float(np.degrees(stop)) for stop in config.travel)
    sensor = "" if tps is None else (f"\n[tps]\nclosed_V = {tps.closed_V!r}\nopen_V = {tps.open_V!r}\n"
                                     f"travel_deg = {float(np.degrees(tps.travel))!r}\n")  # fmt: skip
    return (f"[rig]\nname = {json.dumps(config.name)}\nsynthetic = {str(config.synthetic).lower()}\n"
            f"gear_ratio = {config.gear_ratio!r}\nsupply_V = {campaign.setting.supply!r}\n"
            f"travel_deg = [{low!r}, {high!r}]\n{sensor}")  # fmt: skip
