"""The physics: Eqs. 1-2 of the paper and the named effects beyond them, their parameters, and the one stepper."""
