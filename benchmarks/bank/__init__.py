"""What `etcfit` makes of folders whose truth is known: one bank for training, and frozen the test; one table.

    python -m benchmarks.bank --mix training --jobs 2 --save bank.jsonl
    python -m benchmarks.bank --classes single:backlash edges --folders 5 --first-seed 6500 --save bank.jsonl
    python -m benchmarks.bank --table bank.jsonl --beside old.jsonl --picture bank.png
    python -m benchmarks.bank --mix training --without each --beside bank.jsonl --save without.jsonl

Each folder comes from `independent`, which shares no code with the model. It is read, fitted and diagnosed, and its
record appended to the file at once; a folder that is there with this commit is not run again. Classes:

    clean      nothing is missing
    single     one effect of the catalogue, at every strength
    pair       two of them, clear to see
    outside    an effect that no hypothesis of the catalogue has; `outside:friction_tide` and such came later
    mistake    a mistake of the rig, eleven kinds in turn; `mistake:warm_start` and such by their names
    slow       duty and position at 100 Hz of an ECU that acts at 500 Hz, nothing else wrong
    edges      nothing, one effect or two, and every edge of the input on a sample or a hair beside it
    ecu        setpoint and position alone, gains known, scaled or free (fitted, not diagnosed)

With `--beside OLD.jsonl` the table begins with what got worse, folder by folder: a worse outcome, a parameter further
than 5 standard errors off, two more intervals that miss, three fewer that are stated, no convergence any more.

A seed is a folder for ever. Below 20000 they are for training; from there on they are the test's, and only the mixes
`test`, `test_beside`, `test_logs` and `test_short` run them, each once, by the commit that lands.
"""

from .cases import case as case
from .records import one as one
