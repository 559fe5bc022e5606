"""How the walking policy of the legs is made: what it is given to begin with, its stages, its export, its figures."""
