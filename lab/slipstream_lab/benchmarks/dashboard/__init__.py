"""The dispatcher as a service, under load."""
