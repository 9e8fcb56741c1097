"""Statistics of the estimates of many units: no model, no files, no pictures."""
