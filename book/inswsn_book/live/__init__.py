"""Lessons that run where they are read: Python in the page, or on the reader's own machine."""
