"""The exogenous evaluation, as in the paper: the fleet drives on recorded traffic."""
