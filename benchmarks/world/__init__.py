"""The worlds of a whole day: how long they take, whether they repeat, what is saved in them."""
