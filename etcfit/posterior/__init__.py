"""How sure: emcee samples the posterior of a fit, until the chain is long enough to be called one.

Only here is emcee imported.
"""
