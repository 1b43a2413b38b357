"""Which routes and departures: base routes without platooning (PyVRP), options of each vehicle,
blocks of vehicles for the solvers, and sweeps over the blocks until nothing improves."""
