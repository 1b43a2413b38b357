"""Synthetic delivery cities: streets, depots, stops, vehicles and one moment of traffic."""
