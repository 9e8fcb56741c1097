"""Synthetic rig data from physics written a second time: nothing here knows etcfit, nor its way of stepping."""

from .effects import MEDIUM as MEDIUM
from .effects import NONE as NONE
from .effects import Effects as Effects
from .folder import make_folder as make_folder
from .instruments import Bench as Bench
from .truth import CONSISTENT as CONSISTENT
from .truth import TABLE_2 as TABLE_2
from .truth import Truth as Truth
from .truth import draw_truth as draw_truth
