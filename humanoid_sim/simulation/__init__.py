"""Robots in MuJoCo: model and scene, the plant that applies the MIT law, and measures derived from the model."""

DROP = 0.03
"""m from the feet of a robot that hangs on its support down to the floor, unless its height is given.

Some policies step only once something has disturbed them: set down gently they stand for ever, whatever the command.
Where they were trained, and where their publishers show them, they start above the floor and land. Berkeley Humanoid
Lite's need up to 0.02 m, and are shown from 0.04 m.
"""
