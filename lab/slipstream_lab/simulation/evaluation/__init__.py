"""The measurement: arms of a day, simulated and stored, compared over seeds, and reported.

`arms` names the arms; `runs` simulates and stores them, `measures` computes figures from them,
`exogenous` does both on recorded traffic, `report` makes tables, plots and files.
"""
