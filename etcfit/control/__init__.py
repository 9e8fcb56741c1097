"""From the fitted model to a controller: the linear plant, its measured frequency response, PID gains."""
