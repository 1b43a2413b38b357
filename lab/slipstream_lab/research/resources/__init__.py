"""Variables, constraints and couplings of the arc form, up to N = 50, K = 20."""
