"""Many units of one design: each fitted by itself, side by side, and what they tell of the design together."""
