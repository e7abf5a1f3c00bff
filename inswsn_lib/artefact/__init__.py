"""From chapters to a rendered book: notebooks, execution, cache, rendering, command line."""
