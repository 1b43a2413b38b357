"""Arms of a day set against each other: savings with their time, their ceilings, and a report."""
