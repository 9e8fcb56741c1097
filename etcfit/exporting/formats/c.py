"""C99 of the plant, for hardware in the loop."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np

from ...model.effects import State
from ..base import Export, Format, Source
from ..plant import Plant, advancing, plant_of
from ..rendering import rendered

_LEVELS = (0.0, 8.0, 3.0, 0.0, -6.0, 12.0, 5.0, -12.0, 6.5, 6.6, 6.4, 0.0)  # V, through stick, slip and both stops
_HOLD = 0.05  # s, of each; two rows a level


def sources(source: Source, plant: Plant, cannot_hold: tuple[str, ...] = ()) -> dict[str, str]:
    """Header and source, by name."""
    parts = {"title": source.title, "plant": plant, "notes": (source.origin, *source.cautions, *cannot_hold)}
    return {f"etcfit_plant.{end}": rendered(f"plant.{end}", **parts) for end in ("h", "c")}


def cannot_hold(source: Source) -> Iterator[str]:
    """What differs between the C and the rig."""
    yield (f"The step is fixed at {source.settings.step:g} s and the voltage is constant over it: average a PWM "
           "over each step.")  # fmt: skip
    yield "Noise of the sensors is not in it."
    if source.fitted.config.tps is None:
        yield "The position sensor's volts are not in it: rig.toml has no [tps]."


def _reference(source: Source) -> tuple[list[tuple[float, ...]], int]:
    """Voltage, current, angle and speed along a run of our own stepper from the closed stop, and steps between rows."""
    h, effects = source.settings.step, source.effects
    steps = max(1, round(_HOLD / h))
    volts = np.repeat(_LEVELS, 2 * steps)
    parameters = {**source.values, **source.body}
    late = float(source.throttle.delays().input) / h
    whole = int(late)
    padded = np.concatenate((np.zeros(whole + 1), volts))
    acting = padded[1 : volts.size + 1] + (late - whole) * (padded[: volts.size] - padded[1 : volts.size + 1])
    advance = advancing(effects, h)

    @jax.jit
    def run(acting: jax.Array) -> State:
        def one(carry: Any, volt: jax.Array) -> Any:
            x, z, time = carry
            x, z = advance(parameters, x, z, volt, 0.0, time)
            return (x, z, time + h), x

        z = tuple(jax.numpy.asarray(float(start)) for effect in effects for start in effect.z0)
        x = State(*(jax.numpy.asarray(each) for each in (0.0, parameters["lower"], 0.0)))
        return jax.lax.scan(one, (x, z, jax.numpy.zeros(())), acting)[1]

    path = run(jax.numpy.asarray(acting))
    ends = np.arange(steps - 1, volts.size, steps)
    return [tuple(float(each[k]) for each in (volts, *path)) for k in ends], steps


def _export(source: Source) -> Export:
    plant, lost = plant_of(source), tuple(cannot_hold(source))
    rows, steps = _reference(source)
    test = rendered("plant_test.c", rows=rows, steps=steps, start=source.travel[0])
    return Export({**sources(source, plant, lost), "etcfit_plant_test.c": test}, (*source.cautions, *lost))


FORMAT = Format("c", "C99 of the plant for hardware in the loop", _export)
