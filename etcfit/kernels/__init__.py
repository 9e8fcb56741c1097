"""One graph of arithmetic, traced from the model's own JAX, its printers and its execution.

    JAX  ->  lowering  ->  graph  ->  derivatives  ->  machine code (loop, llvm)   fits, diagnoses, designs
                                                   ->  C99 (c)                     exports
                                                   ->  JavaScript (javascript)     the interactive page

Physics is written once, in JAX, which is the definition: with ETCFIT_KERNELS=jax JAX itself runs.
"""
