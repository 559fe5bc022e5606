"""Studies whose tables the documentation has: each is run by hand, and a test holds its result."""
