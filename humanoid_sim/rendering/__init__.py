"""Pictures of a simulated robot: video, snapshot, window. With OpenGL where it works, in software everywhere else."""
