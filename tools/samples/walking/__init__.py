"""The walking policy of the legs: the gait that it begins with, its stages, its export, its figures."""
