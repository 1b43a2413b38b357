"""Planning of a cycle: roads, routes without platooning, meetings, candidate plans and their check.

- `cycle`: a cycle as a whole, by the form that the settings name
- `arc_form`, `route_form`: the paper's form, and that of fleets
- `improvement`: meetings of vehicles, by sweeps over blocks of them
- `routes`: who serves which stops, by which ways (PyVRP)
- `plans`: candidate plans, physical energy, verification, messages
- `platooning`: who drives with whom, and what that saves
- `roads`: costs of segments and turns, least-energy ways, travel times
- `replay`: what a cycle was made from, and the same cycle made again
"""
