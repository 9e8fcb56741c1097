"""The weighted least-squares problem: traces made ready and batched, what is free, the ONE residual, its Jacobian.

Axes, as the types of all arrays here and in `model` name them (checked under pytest, see `tests/conftest.py`):

    T       steps of a batch, one after the other in time
    L       lanes of a batch, side by side
    M       sample slots: channels observed at the end of a step, or of one trace
    P       free parameters, padding included where a function is compiled; Q all parameters, H those held
    K       points in parameter space, or knots of a smooth effect
    n       instants of one trace; in a filter, error states
    rows    steps of one trace
    lanes   whatever axes a batch has where a function takes one step of it at a time

A field of a `NamedTuple` (`Step`, `SampleSlots`, `Disturbance`, ...) states its shape in a whole batch; inside a scan
the same tuple holds one entry of it, without T, and inside a vmap without L.
"""
