"""Pictures of a simulated robot: page, video, window."""
