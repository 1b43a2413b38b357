"""That a QUBO says what its problem says, by enumeration and exact elimination."""
