"""Mock motors: they speak the families' protocols frame by frame on python-can channels, and MuJoCo moves them."""
