"""From a problem to an optimum, and from an optimum to what is known: the joint fit, intervals, identifiability,
whether the tests agree.

Parts:

    ready, joint_fit, levenberg_marquardt, damped_step, global_search    from the graph readings to the optimum
    identifiability, intervals, autocorrelation, remedies                what the data tell, and how sure
    agreement, pieces, influence, clusters, subsets, disagreement,
    contradiction, compromise, statement                                 whether parts of the data agree
    rig_places                                                           what rig.toml may name
"""
