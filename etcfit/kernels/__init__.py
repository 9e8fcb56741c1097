"""One graph of arithmetic, traced from the model's own JAX, and how it is printed and run.

    JAX  ->  lowering  ->  graph  ->  derivatives  ->  machine code (loop, llvm)   what fits, diagnoses and designs
                                                   ->  C99 (c)                     exports
                                                   ->  JavaScript (javascript)     the interactive page

Physics is written once, in JAX, which stays the definition: ETCFIT_KERNELS=jax runs that instead.
"""
