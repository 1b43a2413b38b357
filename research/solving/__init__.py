"""One instance, chosen solvers: the forms that they get and what their answers are worth."""
