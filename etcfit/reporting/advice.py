"""What `etcfit check --advise` prints: one more trace of each kind, best first, and what it does to each interval."""

from __future__ import annotations

from rich.console import Group, RenderableType
from rich.text import Text

from ..experiment.advice import Advice, Option, Pair
from .blocks import headed, plain_table, rig_title, sentences
from .numbers import short

_NOTED = 0.9  # an interval that shrinks to no less is printed dim


def advice_table(advice: Advice) -> RenderableType:
    """Advice for stdout."""
    parts = [
        rig_title(advice.rig.config, "what one more trace would tell"),
        _summary(advice),
        _shares(advice),
        sentences("Not judged", [f"{test}: {why}." for test, why in advice.not_judged]),
    ]
    return Group(*(part for part in parts if part is not None))


def _summary(advice: Advice) -> RenderableType:
    table = plain_table("test", "how", "mean width", "separates", prose=("how", "separates"), spare=("separates",),
                        file="advice.json of --out RUN")  # fmt: skip
    for option in advice.options:
        how = option.says + (f" ({option.remark})" if option.remark else "")
        table.add_row(option.test, how, f"{option.mean:.2f}", _pair(option.separates))
    return headed("One more trace, best first; mean width: of all 95 % intervals after it, 1 is now", table)


def _pair(pair: Pair | None) -> str:
    if pair is None:
        return "-"
    first, second = pair.symbols
    return f"{first} and {second} (correlation {pair.before:.3f} -> {pair.after:.3f})"


def _shares(advice: Advice) -> RenderableType:
    """A row a parameter, a column an option."""
    table = plain_table("parameter", "standard error now, %", *map(_label, advice.options))
    for k, symbol in enumerate(advice.symbols):
        table.add_row(symbol, short(100.0 * advice.sd[k], 2), *(_share(each.shrinks[k]) for each in advice.options))
    return headed("Width of each 95 % interval after one more trace; 1 is its width now", table)


def _label(option: Option) -> str:
    return option.test + (", again" if option.again else ", new")


def _share(share: float) -> Text:
    return Text(f"{share:.2f}", style="dim" if share > _NOTED else "bold")
