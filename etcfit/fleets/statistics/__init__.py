"""What the estimates of many units tell together: no model, no files, no pictures."""
