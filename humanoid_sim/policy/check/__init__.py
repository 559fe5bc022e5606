"""Static checks of a checkpoint: of its contract alone, of its model, and against a robot that it is meant for."""
