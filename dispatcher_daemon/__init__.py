"""The dispatcher: segment states, orders and vehicles in; verified plans with their energy out."""
