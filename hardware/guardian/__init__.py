"""A process that stands by for motors which execute their last command for ever: it brakes them when the loop is gone.

`protocol` is what both share: the plan, as data that knows no family of motors, and the memory with their signs of
life. `process` is what it does, and `guardian` the loop's end.
"""
