"""The physics: Eqs. 1-2 of the paper, the named effects beyond them, their parameters, and the one stepper.

Parts:

    throttle, stepper, tangents     one step of the balances, and its exact derivative
    pid, ecu, ecus/                 the discrete PID; engine computers, and their makes
    effects/, rig_effects/          physics of the throttle; mistakes of the rig around it
    smooth/                         curves for unknown causes
    linear                          the transfer function
"""
