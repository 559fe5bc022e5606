"""The control loop around the pure stack: it reads, steps, writes, and hands each tick to the sinks."""
