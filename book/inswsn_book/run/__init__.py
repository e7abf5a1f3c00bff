"""Chapters in kernels, the store that keeps their runs, and how one run differs from another."""
