"""RUN/: its JSON files, the models that later stages load, and the manifest that says what was made from what.

`codec` writes any frozen object whole and loads it bit for bit; `manifest` is run.json; `commit` puts the files of a
stage in place, all or none; `state` holds the models. A module for each family of JSON files.

Nothing is imported here: who reads a fit need not load what writes gains and posteriors.
"""

from __future__ import annotations
