"""Transfer function and gains, for the terminal and as pictures."""
