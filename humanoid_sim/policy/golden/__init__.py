"""Golden vectors: samples of a policy's run inside its checkpoint, computed again at every load.

Samples of the trainer's run show that this program wires the policy as the trainer did. Samples that this program made
itself only show that nothing has changed since: they are labelled `drift only`.
"""
