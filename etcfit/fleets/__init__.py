"""Many units of one design: each is fitted by itself, in parallel; then the design is estimated from all of them.

folder, config, unit    the fleet's folder, fleet.toml, units.csv, the stored result of each unit
fitting, engine/        Dask: workers, time limits, the store from which a second start resumes
study, statistics/      population, shrinkage, odd units, charts, drift, capability, gauge; no traces
line                    the figures that a production line measures, and their predictions hot, cold and on a battery
"""
