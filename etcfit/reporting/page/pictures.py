"""The run's pictures, small enough to be carried in the page itself."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

from .captions import caption

BUDGET = 4_500_000  # bytes of the page that pictures may take; docs/commands/report.md promises less than 5 MB in all
_COLOURS = 64  # of a plot: enough for lines, bands and the grey of their edges

# folder below RUN/pictures -> title of its group, in the order of interest; folders not named here follow
GROUPS = {
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
OPEN = ("", "diagnosis", "posterior", "control")  # shown without a click


@dataclass(frozen=True)
class Picture:
    """A picture in the page.

    Args:
        name: of its file, as it is spoken.
        caption: what it shows, a sentence.
        uri: data URI.
        width, height: px.
    """

    name: str
    caption: str
    uri: str
    width: int
    height: int


@dataclass(frozen=True)
class Group:
    """Pictures of one kind.

    Args:
        title: of the group.
        folder: below RUN/pictures.
        pictures: in the order of their names.
        left_out: names of those for which there was no room.
    """

    title: str
    folder: str
    pictures: tuple[Picture, ...]
    left_out: tuple[str, ...]

    @property
    def open(self) -> bool:
        """Shown without a click."""
        return self.folder in OPEN or self.folder not in GROUPS


def groups(run: Path, budget: int = BUDGET) -> list[Group]:
    """Every picture of a run folder, as many as there is room for, the ones of most interest first.

    Args:
        run: the run folder.
        budget: bytes that they may take.
    """
    base, room, out = run / "pictures", budget, []
    with ThreadPoolExecutor() as pool:  # Pillow lets go of Python's lock
        drawn = [
            (*each, pool.map(partial(carried, folder=each[0]), _inside(base / each[0]))) for each in _folders(base)
        ]
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


def carried(path: Path, folder: str = "") -> Picture:
    """A PNG with few colours, as a data URI.

    Args:
        path: of the file.
        folder: below RUN/pictures that it lies in.
    """
    small, (width, height) = _with_few_colours(path.read_bytes())
    text = base64.b64encode(small).decode("ascii")
    return Picture(_spoken(path.stem), caption(folder, path.stem), f"data:image/png;base64,{text}", width, height)


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


def _inside(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.png"))


def _spoken(stem: str) -> str:
    return " · ".join(part.replace("_", " ") for part in stem.split("__"))
