"""Tools that one would pick in place of etcfit, side by side on one folder of rig traces whose truth is known.

    python -m benchmarks.peers                                  all of them: some minutes each on one core
    python -m benchmarks.peers --peers scipy,mujoco --seed 2
    python -m benchmarks.peers --markdown docs/validation/peers.md

The packages are the extra `benchmark`. The folder comes from `independent`, which shares code with none of them, and
holds nothing beyond Eqs. 1-2. Every peer gets the same traces as etcfit prepares them before any fit (input freed of
noise, instants of its jumps, first states, noise of each channel), the same start (the slopes read off the graphs) and
the same free parameters, release instants among them. Each is a fresh process on one core, its imports and what it
compiles counted; etcfit is its command `etcfit fit` on the same folder, files and pictures included.
"""
