"""Hands out many units to Dask workers and stores their results, so that a run can resume; independent of throttles."""
