"""Robots in MuJoCo: model and scene, the plant that applies the MIT law, and measures derived from the model."""
