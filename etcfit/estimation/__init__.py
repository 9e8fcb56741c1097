"""The joint fit, from a problem to an optimum, and its evaluation: intervals, identifiability, whether the tests agree.

Parts:

    ready, joint_fit, levenberg_marquardt, damped_step    from the graph readings to the optimum near the data
    rounds, free_run, edges                               whitening; the fit of a far model; phases of edges
    statement, contradiction, agreement                   whether parts of the data agree
    identifiability, intervals, goodness, explained       what the data determine, how well, and the residual
    result, fitted_model                                  the result; the model alone, of one unit or many

Arguments that recur here and in `diagnosis`, so that docstrings do not repeat them: `x`, coordinates of the free
parameters, shape (P,); `problem`, the traces; `weighted`, their data under one whitening; `reach` of each coordinate,
shape (P,); `unknown`, standard deviation in reaches above which a parameter is not known; `believed`, the statement of
the priors; `settings`, thresholds and budgets; `report`, called with the current step and the share done; `result`,
the first fit; `s`, a `CandidateModel`.
"""
