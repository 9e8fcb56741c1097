"""From the fitted model to a controller: the linear plant, its measured frequency response, PID gains for one unit
or for a fleet.

Parts:

    pid/                    tuning rules, the loop with its ECU, margins, scenarios
    frequency/              sines: measured response, order of lag
    design, supply_table    one design; gains over the supply
    fleet, fleet_verdict    gains for many units; parts, parts_verdict: for one unit's model, a fleet being its kind
"""
