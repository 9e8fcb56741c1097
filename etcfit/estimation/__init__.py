"""From a problem to an optimum, and from an optimum to what is known: the joint fit, intervals, identifiability,
whether the tests agree.

Parts:

    ready, joint_fit, levenberg_marquardt, damped_step    from the graph readings to the optimum near the data
    rounds, free_run, edges                               its whitening; the way of a model that is far; shared phases
    statement, contradiction, agreement                   whether parts of the data agree
    identifiability, intervals, goodness, explained       what the data tell, how sure, and what is left
    result, fitted_model                                  what a fit leaves behind; the model alone, of one unit or many

Arguments that recur here and in `diagnosis`, so that docstrings do not repeat them: `x`, coordinates of the free
parameters, shape (P,); `problem`, the traces; `weighted`, their data under one whitening; `reach` of each coordinate,
shape (P,); `unknown`, standard deviation in reaches above which a parameter is not known; `believed`, what the priors
say; `settings`, thresholds and budgets; `report`, called with what is going on and the share done; `result`, the first
fit; `s`, a `CandidateModel`.
"""
