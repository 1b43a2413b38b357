"""The fleet's vehicles in a running simulation: they sense, obey their agents' advice, and serve.

A vehicle here is what a real one is to Slipstream: a driver with a car that senses. `sensing` reads
SUMO for it, `actuation` obeys advice in SUMO, `world` is the day of all vehicles, and `exchange`
carries messages in one process where no bus is wanted.
"""
