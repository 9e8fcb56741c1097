"""What `etcfit diagnose` finds in folders whose missing physics is known, and what it takes for what.

    python -m benchmarks.confusion --first-seed 1000 --folders 200 --save confusion.jsonl
    python -m benchmarks.confusion --table confusion.jsonl --picture confusion.png

Each folder comes from independent, which shares no code with the model and whose effects differ in detail from
those of the same name there. A seed is a case: of 200 in a row 30 have no effect, 105 one effect of the catalogue
(every one at every strength), 35 two of them, and 30 one that is outside the catalogue.

Seeds 9000 to 9199 were the first TEST, seeds from 20000 on the second: each run once; what was recorded of them lies
in `test_set` and `test_set_2`. Any seed below 9000 is for tuning.
"""

from __future__ import annotations

from .cases import case as case
from .records import one as one
