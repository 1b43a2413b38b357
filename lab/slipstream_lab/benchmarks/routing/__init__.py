"""How good and how fast the routing core is: named instances, generated cities, fleet sizes."""
