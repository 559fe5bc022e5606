"""Programs that measure the package, not installed with it: `python -m tools.bench`."""
