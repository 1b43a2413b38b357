"""Backup and restore, and what becomes of a damaged file."""
