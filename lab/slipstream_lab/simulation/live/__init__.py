"""The closed loop in real time: SUMO serves cameras, real daemons perceive and plan, vehicles obey.

`process` starts the world as a subprocess, `world` runs it, `camera` streams one RSU's pictures.
"""
