"""The next best test: what one more trace of each kind would do to the intervals, before anybody measures it.

    F' = F + J_k^T J_k,    sd' / sd = sqrt((F'^-1)_ss / (F^-1)_ss)

J_k is the whitened Jacobian of a trace that does not exist yet, simulated as planned with the rig's own noise, or that
of a trace that is there, measured once more.
Source: optimal experiment design by Fisher information, Ljung 1999, ch. 13. Differs from source: no.
"""

from __future__ import annotations

from .advice import Advice as Advice
from .advice import Option as Option
from .advice import advise as advise
