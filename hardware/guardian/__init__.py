"""A process that stands by for motors which execute their last command for ever: it brakes them when the loop is gone.

`plan` is what it is told, as data: it knows no family of motors. `heartbeat` is the memory that it shares with the
loop, `process` is what it does, and `guardian` the loop's end.
"""
