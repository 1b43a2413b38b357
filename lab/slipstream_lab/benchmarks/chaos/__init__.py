"""Faults, one after the other, into the running daemons: what is lost, and how soon all is well."""
