"""What makes and measures the package, and is not installed with it: `python -m tools.samples`, `tools.bench`."""
