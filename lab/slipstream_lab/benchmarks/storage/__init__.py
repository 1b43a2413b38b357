"""Thirty days of a city in the database: its size, its queries, and what deleting takes."""
