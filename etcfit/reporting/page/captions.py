"""What each picture of a run shows, a sentence."""

from __future__ import annotations

from ..control.captions import CAPTIONS

_ONE = {f"control/{stem}": said for stem, said in CAPTIONS.items()} | {
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
    """Of a picture by the folder below RUN/pictures and its file's name; a newcomer's is its name.

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
        return f"{stem}: where the plate is and how fast it moves, and the seconds in which most is asked of it."
    name = "/".join(part.replace("_", " ") for part in stem.split("__"))
    return _EACH.get(folder, "{}.").format(name[:1].upper() + name[1:] if folder.endswith("traces") else name)
