"""CAN channels on python-can: addresses, the exclusive lock, a receiver and a sender thread, counters and faults."""
