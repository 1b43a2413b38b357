"""The closed loop in real time: SUMO serves cameras, real daemons watch and plan, vehicles obey."""
