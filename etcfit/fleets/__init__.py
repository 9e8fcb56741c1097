"""Many units of one design: each is fitted by itself, side by side; then what they tell of the design together.

folder, config, unit    the fleet's folder, fleet.toml, units.csv, what each unit leaves behind
fitting, engine/        Dask: workers, time limits, the store that a second start goes on from
study, statistics/      population, shrinkage, odd units, charts, drift, capability, gauge; knows no traces
line                    the figures that a production line measures, and what they will be hot, cold and on a battery
"""
