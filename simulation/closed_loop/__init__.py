"""The fleet drives in SUMO: dispatched on what RSUs see, advised by its plans, then measured."""
