"""The machinery of the book: chapters are run, recorded, judged and shown."""
