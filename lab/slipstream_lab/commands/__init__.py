"""Commands of a researcher: instances, solvers, clips, models, simulated days, tables."""
