"""How long etcfit takes and how much memory: an old version beside a new one, in one run.

    python -m benchmarks.speed                                       all rows, three times each: hours
    python -m benchmarks.speed --rows check,start --repeats 1
    python -m benchmarks.speed --old 3cff18f --new . --markdown docs/validation/speed.md

Each measurement is a fresh process with compiled models of its own: `cold` begins with none, `warm` does the same again
with those that `cold` left. Wall time counts whatever else the machine did meanwhile, CPU time (user + system) does
not; versions take turns, so that a busy machine is busy for both. Folders of measurements are the same for both; a fit
that a command goes on from is each version's own and is not counted. The table holds medians; stderr every figure.

`--old` and `--new` name a commit, whose files are taken from git, or a folder with a tree of this project.
"""
