"""From a problem to an optimum, and from an optimum to what is known: the joint fit, intervals, identifiability."""
