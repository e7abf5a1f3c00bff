"""Lessons that run where they are read: Python in the page."""
