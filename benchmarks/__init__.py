"""Figures of the documentation, a module each: `python -m benchmarks.NAME --help`, from the project's root."""
