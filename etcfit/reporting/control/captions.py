"""What each picture of control shows, a sentence or two below it on the page."""

from __future__ import annotations

CAPTIONS = {
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
"""By name of the file in RUN/pictures/control, without its ending."""
