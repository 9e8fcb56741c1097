"""The weighted least-squares problem: traces made ready and batched, what is free, the ONE residual, its Jacobian."""
