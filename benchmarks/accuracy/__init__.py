"""How true the perception is: clips of both worlds against their ground truth."""
