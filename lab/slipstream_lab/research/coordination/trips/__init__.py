"""The law of the trips: their roads, and who wants to drive where and when."""
