"""The cycle in route form: a plan of the fleet from base routes and sweeps."""
