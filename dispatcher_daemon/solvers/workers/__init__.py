"""Where solvers run: worker processes under hard deadlines, any executor, or this process."""
