"""The page a dispatcher watches: where the vans are, which roads are calm, what was saved."""
