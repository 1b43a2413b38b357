"""The agent of one vehicle: plan, states, signal timing and partners in; advice and answers out."""
