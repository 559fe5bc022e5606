"""Programs that make and measure the package, not installed with it: `python -m tools.samples`, `tools.bench`."""
