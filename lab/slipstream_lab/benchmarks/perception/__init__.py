"""How fast is the edge? Our pipeline and Ultralytics on one clip in turns, and cameras live."""
