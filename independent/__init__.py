"""Synthetic rig data from physics written a second time: nothing here knows etcfit, nor its way of stepping."""

from .effects import CATALOGUE as CATALOGUE
from .effects import FURTHER as FURTHER
from .effects import NONE as NONE
from .effects import OUTSIDE as OUTSIDE
from .effects import Effects as Effects
from .effects import combine as combine
from .folder import left_by_itself as left_by_itself
from .folder import make_folder as make_folder
from .instruments import Bench as Bench
from .strengths import MEDIUM as MEDIUM
from .strengths import STRENGTHS as STRENGTHS
from .truth import CONSISTENT as CONSISTENT
from .truth import TABLE_2 as TABLE_2
from .truth import Truth as Truth
from .truth import draw_truth as draw_truth
