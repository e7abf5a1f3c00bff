"""The pictures of the lessons: what a cell shows in a line, and does not teach."""
