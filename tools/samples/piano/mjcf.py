"""MJCF of a piano: what `assets/mjcf/piano_*.xml` hold."""

from __future__ import annotations

from humanoid_sim.robots.piano import PianoFigures


def piano_mjcf(figures: PianoFigures, name: str) -> str:
    """Return what an MJCF includes in the body `piano`, whose frame is the piano's and whose class is `piano`.

    Args:
        figures: what it is built from.
        name: of the figures, for the comment.
    """
    rear, under = figures.boxes
    lines = [
        "<mujocoinclude>",
        f"  <!-- The piano {name}: written by humanoid_sim/robots/piano.py, class piano in piano_style.xml. -->",
        '  <inertial mass="10" pos="{} 0 {}" diaginertia="0.1 0.1 0.1"/>'.format(
            *(_number(rear.position[i]) for i in (0, 2))
        ),
        *(
            f'  <geom name="piano_{part}" class="piano_base" pos="{_numbers(box.position)}" '
            f'size="{_numbers(box.size)}"/>'
            for part, box in (("rear", rear), ("under", under))
        ),
    ]
    for key in figures.keys:
        colour, hinge = "white" if key.is_white else "black", key.hinge - key.box.position[0]
        lines += [
            f'  <body name="{key.name}" pos="{_numbers(key.box.position)}">',
            f'    <joint name="{key.joint}" class="{colour}_key" pos="{_number(hinge)} 0 0" '
            f'range="0 {_number(key.upper)}" stiffness="{_number(figures.stiffness)}" '
            f'damping="{_number(figures.damping)}" springref="{_number(figures.spring_reference)}" '
            f'armature="{_number(figures.armature)}"/>',
            f'    <geom name="{key.name}" class="{colour}_key" size="{_numbers(key.box.size)}" '
            f'mass="{_number(key.mass)}"/>',
            "  </body>",
        ]
    return "\n".join([*lines, "</mujocoinclude>", ""])


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    return f"{round(value, 12) + 0.0:.12g}"
