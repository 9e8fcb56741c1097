"""The run's pictures, small enough for the page itself, each with a sentence on its contents."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

_CONTROL = {
    "bode": "The frequency response of the linear model: amplitude in dB and phase in degrees over frequency in Hz, "
    "with its 95 % interval. Dry friction has no place in it.",
    "sines": "The frequency response that the sine traces show, beside that of the model: the distance between them is "
    "what the linear model leaves out.",
    "responses": "Every tuning rule in the scenario that is hardest for it: a response that enters the shaded part "
    "misses a requirement, and the title says which.",
    "scenarios": "The proposed gains in every scenario: setpoint and position in % of travel, with the band that holds "
    "95 % of the models.",
    "front": "Tracking error in % of travel over the restlessness of the duty in % of the supply, on the nominal "
    "model. The line is the least error that was found; a cross below it misses another requirement, which it names.",
    "safety": "What the proposed gains do where something fails: jam check, position sensor, loss of the current, and "
    "what holding the plate takes.",
}
"""Captions by name of the file in RUN/pictures/control, without its suffix."""


_ONE = {f"control/{stem}": said for stem, said in _CONTROL.items()} | {
    "parameters": "The distance of every free parameter from its fitted value, in per cent: its 95 % interval, the "
    "reading off the paper's graph, and the paper's Table 2, which is of another rig.",
    "diagnosis/ledger": "The free-running error of every channel before and after the diagnosis, in σ, the noise of "
    "one sample; on the right in its own unit.",
    "diagnosis/missing_torque": "The torque that the model lacks along the measured motion, above before and below "
    "after the diagnosis, over the quantities on which it depends most.",
    "diagnosis/missing_voltage": "The voltage that the model lacks along the measured current, above before and below "
    "after the diagnosis, over the quantities on which it depends most.",
    "diagnosis/rounds": "The free-running error after each round of the diagnosis, and what else was tried.",
    "diagnosis/unexplained": "What no effect of the catalogue explains: a curve and two standard deviations about it.",
    "posterior/intervals": "The 95 % interval of every parameter by the fit, by its profile and by the posterior.",
    "posterior/corner": "The posterior of every pair of parameters, and on the diagonal of each alone.",
    "tune/tune": "Above, a part of the log that was held out, measured and predicted: two lines that lie on each other "
    "are good. Below, large steps by each set of gains, simulated with the fitted model.",
    "posterior/profiles": "The least misfit over each parameter, all others fitted anew.",
}
_EACH = {
    "traces": "{}: measured and simulated by the final model, what is left below each channel, and what drove it.",
    "tests": "The {} test: its graphs as the paper reads them, and the final model read in the same way.",
    "diagnosis/traces": "{}: measured, the model before and after the diagnosis, their errors, and what drove it.",
    "posterior/bands": "{}: measured, and the band that the posterior predicts.",
    "before": "Before: the parameters of the first fit, which the diagnosis replaced.",
    "before/traces": "{}: measured and simulated by the first fit, which the diagnosis replaced.",
    "before/tests": "The {} test: its graphs, and the first fit read in the same way, which the diagnosis replaced.",
}


def caption(folder: str, stem: str) -> str:
    """Caption of a picture by its folder below RUN/pictures and its file's name; for an unknown picture its name.

    Args:
        folder: "" for RUN/pictures itself.
        stem: the file's name without its ending; of a trace the test and the trace with two underscores between.
    """
    if said := _ONE.get(f"{folder}/{stem}".lstrip("/")):
        return said
    if folder == "drive":
        if stem.endswith("_answers"):
            return (f"{stem.removesuffix('_answers')}: answers to every step over the step, the error by parts of the "
                    "travel, and one sensor over the other, as far as the log has them.")  # fmt: skip
        return f"{stem}: angle and speed of the plate, and the seconds with the fastest setpoint."
    name = "/".join(part.replace("_", " ") for part in stem.split("__"))
    return _EACH.get(folder, "{}.").format(name[:1].upper() + name[1:] if folder.endswith("traces") else name)


BUDGET = 4_500_000  # largest size of all pictures in the page, bytes; commands/report.md states less than 5 MB in all
_COLOURS = 64  # colours of a plot: enough for lines, bands and the grey of their edges

# folder below RUN/pictures -> title of its group, in the order of interest; folders not named here follow
GROUPS = {
    "tune": "Gains, step by step",
    "diagnosis": "What the model lacked",
    "": "Parameters of the final model",
    "posterior": "How sure",
    "control": "The linear model and the loop",
    "diagnosis/traces": "Before and after, trace by trace",
    "traces": "Trace by trace, measured and simulated by the final model",
    "posterior/bands": "Posterior predictive bands, trace by trace",
    "tests": "Test by test, as the paper reads its graphs",
    "before": "Before: parameters of the first fit, which the diagnosis replaced",
    "before/traces": "Before: trace by trace, simulated by the first fit, which the diagnosis replaced",
    "before/tests": "Before: test by test, the first fit, which the diagnosis replaced",
}
OPEN = ("", "tune", "diagnosis", "posterior", "control")  # shown without a click


@dataclass(frozen=True)
class Picture:
    """A picture in the page."""

    name: str  # name of its file, in words
    caption: str  # what it shows, a sentence
    uri: str  # data URI
    # width, height: px
    width: int
    height: int


@dataclass(frozen=True)
class Group:
    """Pictures of one kind."""

    title: str  # title of the group
    folder: str  # below RUN/pictures
    pictures: tuple[Picture, ...]  # in the order of their names
    left_out: tuple[str, ...]  # names of pictures left out for lack of space

    @property
    def open(self) -> bool:
        """Whether the group is shown without a click."""
        return self.folder in OPEN or self.folder not in GROUPS


def groups(run: Path, budget: int = BUDGET) -> list[Group]:
    """The pictures of a run folder that fit into so many bytes, those of most interest first."""
    base, room, out = run / "pictures", budget, []
    with ThreadPoolExecutor() as pool:  # Pillow releases Python's lock
        drawn = [(*each, pool.map(partial(carried, folder=each[0]), _drawn(base, each[0]))) for each in _folders(base)]
    for folder, title, pictures in drawn:
        taken, left_out = [], []
        for picture in pictures:
            if len(picture.uri) <= room:
                room -= len(picture.uri)
                taken.append(picture)
            else:
                left_out.append(picture.name)
        if taken or left_out:
            out.append(Group(title, folder, tuple(taken), tuple(left_out)))
    return out


def _drawn(base: Path, folder: str) -> list[Path]:
    """The pictures of a group; that of `etcfit tune`, RUN/pictures/tune.png, is a group of its own."""
    if folder == "tune":
        return [path for path in [base / "tune.png"] if path.is_file()]
    return [path for path in sorted((base / folder).glob("*.png")) if path != base / "tune.png"]


def carried(path: Path, folder: str = "") -> Picture:
    """A PNG in a folder below RUN/pictures with few colours, as a data URI."""
    small, (width, height) = _with_few_colours(path.read_bytes())
    text = base64.b64encode(small).decode("ascii")
    spoken = " · ".join(part.replace("_", " ") for part in path.stem.split("__"))
    return Picture(spoken, caption(folder, path.stem), f"data:image/png;base64,{text}", width, height)


@lru_cache(maxsize=256)  # `etcfit run` writes its page up to three times
def _with_few_colours(png: bytes) -> tuple[bytes, tuple[int, int]]:
    """A PNG made small, and its width and height, px."""
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        few = image.convert("RGB").quantize(_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        buffer = io.BytesIO()
        few.save(buffer, format="PNG")
        return buffer.getvalue(), image.size


def _folders(base: Path) -> Iterator[tuple[str, str]]:
    yield from GROUPS.items()
    for path in sorted(path for path in base.rglob("*") if path.is_dir()):
        folder = path.relative_to(base).as_posix()
        if folder not in GROUPS:
            yield folder, folder.replace("_", " ").replace("/", ", ").capitalize()
