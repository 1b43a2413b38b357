"""By which ways: what a segment and a turn cost, least-energy ways between the fleet's places, and
the times of a vehicle that drives them."""
