"""How far the states and tracks of a clip are from its ground truth."""
