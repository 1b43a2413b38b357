"""The agent of one vehicle: plan, states, signal timing and partners in; advice and answers out.

It runs on a telematics box: no simulator, no database. `agent` is the whole of it as a pure object,
`daemon` puts agents on the bus.
"""
