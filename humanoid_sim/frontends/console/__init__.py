"""The console: a page for the operator of a running session."""
