"""Many units handed out to workers on Dask, and their results to a store that resumes; knows nothing of throttles."""
