"""Worlds of a whole day: networks, background traffic, deliveries and RSUs, from seeds.

`scenario` reads one by name or from files, `day` simulates its background, `gates` judges whether
the day is fit for an evaluation.
"""
