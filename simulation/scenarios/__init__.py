"""Worlds of a whole day: networks, background traffic, deliveries and RSUs, from seeds."""
