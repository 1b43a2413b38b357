"""The paper's tables of quantum solvers, measured anew on the named instances of 25 variables."""
