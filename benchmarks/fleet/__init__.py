"""What `etcfit fleet` takes, finds and survives, on fleets of the independent generator.

    python -m benchmarks.fleet.thousand    1,000 units on two workers: time, memory of all processes, odd units found
    python -m benchmarks.fleet.power       which mistakes anybody could tell from the spread of the parts
    python -m benchmarks.fleet.coverage    intervals of the population over many fleets; shrunk units against their own
    python -m benchmarks.fleet.workers     two workers over one
    python -m benchmarks.fleet.overhead    100,000 units with a stub for a fit: time a unit, memory of the client
    python -m benchmarks.fleet.chaos       workers and client killed, broken folders, a full disk

Seeds from 8000 on are for training; the test set's are not among the defaults.
"""
