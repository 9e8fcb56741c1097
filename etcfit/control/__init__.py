"""From the fitted model to a controller: the linear plant, its measured frequency response, PID gains for one unit
or for a fleet.

Parts:

    pid/           tuning rules, the loop with its ECU, margins, scenarios and conditions
    frequency/     sines: measured response, order of lag
    safety/        behaviour of the gains when a part fails
    design         one design; `fleet`: gains for many units, or for one unit with the scatter of its fleet
"""
