"""The weighted least-squares problem: prepared and batched traces, free parameters, the ONE residual, its Jacobian.

    chi2(x) = sum r^2 + sum ((x - mean) / sd)^2,    r = W (y - y_hat(x))

y are the samples, y_hat the simulation, W a whitening filter: r is standard normal if the model is right. x are
coordinates: unbounded numbers, one for each free parameter (see `model.parameters`).

Parts:

    trace, batch, breaks, packing, edges, substeps      traces as arrays that one program simulates together
    input_signal, setpoint, ticks, instants             the input of a trace, and instants that were not logged
    free_parameters, weights, problem                   free parameters, and the problem as a whole
    residual, one_pass, chi2, jacobian                  the residual, also entry by entry with its derivative
    process_noise, innovations                          the whitening filter
    *_kernels, traced_entry, records, lanes, cores      the same as machine code, on every core

Words:

    trace       one measurement: samples at rising instants
    interval    from one instant of a trace to the next; cut into one or more integration steps (substeps)
    batch       many traces as rectangular arrays, so that one compiled program simulates them together
    lane        a column of a batch: traces in sequence
    entry       a row of a lane: one integration step, and the samples at its end; the first entry of a trace has
                length 0 and is its first instant
    slot        one channel at one entry; its weight is 0 where nothing was logged
    edge        an interval in which the input jumps, at an instant that was not logged
    release     the instant at which a plate held by hand was released
    guide       a spring that pulls the simulated plate along the measured angle; a free run has none

Axes in the types of all arrays here and in `model` (checked under pytest, see `tests/conftest.py`):

    T       steps of a batch, in order of time
    L       parallel lanes of a batch
    M       sample slots: channels observed at the end of a step, or of one trace
    P       free parameters, in a compiled function with padding; Q all parameters, H the held ones
    K       points in parameter space, or knots of a smooth effect
    n       instants of one trace; in a filter, error states
    rows    steps of one trace
    lanes   any axes of a batch, in a function that takes one step at a time

A field of a `NamedTuple` (`Step`, `SampleSlots`, `Disturbance`, ...) states its shape in a whole batch; inside a scan
the same tuple holds one entry of it, without T, and inside a vmap without L.
"""
