"""A cycle: the situation in, the plans of a whole fleet out."""
