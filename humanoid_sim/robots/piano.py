"""Piano that stands in front of a robot: figures of 88 hinged keys with springs.

The figures are those of T-K-233/Robot-Descriptions, commit 44985c9 (its piano generator, Apache-2.0, goes back to
RoboPianist, Zakka et al. 2023). The piano frame has its origin on top of the white keys, at their back edge, in the
middle of the keyboard; +x points towards the player, +z up, low notes are at -y. A positive angle presses a key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

KEY_COUNT = 88
FIRST_NOTE = 21
"""MIDI number of the lowest key, A0."""
TRIGGER = 0.70
"""Share of its travel beyond which a key sounds, strictly."""
_WHITE = frozenset({0, 2, 4, 5, 7, 9, 11})
"""Pitch classes of the white keys."""
_A_SHARP = 1
"""The lowest black key, which alone sits in the middle of its gap."""


@dataclass(frozen=True, slots=True)
class Box:
    """A part of the piano, in the piano frame."""

    position: tuple[float, float, float]
    """m, of its centre."""
    size: tuple[float, float, float]
    """m, half extents."""


@dataclass(frozen=True, slots=True)
class Key:
    """One key, released."""

    index: int
    """0 is A0, MIDI note 21; 87 is C8."""
    is_white: bool
    box: Box
    hinge: float
    """m, x of its axis, which is along +y, in the piano frame."""
    upper: float
    """rad, its whole travel."""
    mass: float
    """kg, of the uniform box."""

    @property
    def name(self) -> str:
        """Return its body's name; its joint is called alike."""
        return f"{'white' if self.is_white else 'black'}_key_{self.index}"

    @property
    def joint(self) -> str:
        """Return its joint's name."""
        return f"{'white' if self.is_white else 'black'}_joint_{self.index}"

    @property
    def lever(self) -> float:
        """m, from its axis to its front edge."""
        return self.box.position[0] + self.box.size[0] - self.hinge

    @property
    def top(self) -> float:
        """m, z of its upper face in the piano frame."""
        return self.box.position[2] + self.box.size[2]


@dataclass(frozen=True, slots=True)
class PianoFigures:
    """Figures that a piano is built from: m, kg, rad, N·m."""

    white_width: float
    """m, and as high"""
    white_length: float
    """m, of what one sees of a white key."""
    white_lever: float
    """m, from a white key's hinge to its front edge."""
    black_lever: float
    base_height: float
    """m, of the rear part, which rises above the keys."""
    base_rear_length: float
    """m, along x, of that part; it ends where the keys begin."""
    base_length: float
    """m, along x, of the whole."""
    base_width: float
    """m, along y"""
    surface_height: float
    """m, of the white keys' surface above the piano's underside."""
    spacing: float = 0.001
    """m, between neighbouring white keys."""
    black_width: float = 0.01
    black_length: float = 0.09
    black_height: float = 0.018
    black_offset: float = 0.0125
    """m, by which black keys rise above white ones."""
    white_travel: float = 0.012
    """m, of the front edge."""
    black_travel: float = 0.008
    white_mass: float = 0.04
    black_mass: float = 0.02
    spring_reference: float = -0.01
    """rad, where the spring is at rest."""
    stiffness: float = 4.0
    """N·m/rad"""
    damping: float = 0.05
    """N·m·s/rad"""
    armature: float = 0.001
    """kg·m²"""

    @property
    def pitch(self) -> float:
        """m, from one white key to the next."""
        return self.white_width + self.spacing

    @property
    def boxes(self) -> tuple[Box, Box]:
        """The body of the piano: the part behind the keys, and the one under them."""
        bottom, rear = -self.surface_height, -self.base_rear_length
        front = self.base_length - self.base_rear_length
        return (
            _box((rear, 0.0), (bottom, bottom + self.base_height), self.base_width),
            _box((rear, front), (bottom, -self.white_width), self.base_width),
        )

    @property
    def keys(self) -> tuple[Key, ...]:
        """All 88, from the lowest."""
        whites = [(i + FIRST_NOTE) % 12 in _WHITE for i in range(KEY_COUNT)]
        left = 0.5 * (sum(whites) * self.pitch - self.spacing)
        made = []
        for i, is_white in enumerate(whites):
            n = sum(whites[:i])
            if is_white:
                y = -left + 0.5 * self.white_width + n * self.pitch
                size = 0.5 * self.white_length, 0.5 * self.white_width, 0.5 * self.white_width
                top, lever, travel, mass = 0.0, self.white_lever, self.white_travel, self.white_mass
            else:
                y = -left + n * self.pitch - (0.5 * self.spacing if i == _A_SHARP else 0.0)
                size = 0.5 * self.black_length, 0.5 * self.black_width, 0.5 * self.black_height
                top, lever, travel, mass = self.black_offset, self.black_lever, self.black_travel, self.black_mass
            made.append(
                Key(
                    index=i,
                    is_white=is_white,
                    box=Box((size[0], y, top - size[2]), size),
                    hinge=2.0 * size[0] - lever,
                    upper=math.atan(travel / lever),
                    mass=mass,
                )
            )
        return tuple(made)


def _box(x: tuple[float, float], z: tuple[float, float], width: float) -> Box:
    """From the spans along x and z, and the width along y around 0."""
    centre = 0.5 * (x[0] + x[1]), 0.0, 0.5 * (z[0] + z[1])
    return Box(centre, (0.5 * (x[1] - x[0]), 0.5 * width, 0.5 * (z[1] - z[0])))


PIANOS: Mapping[str, PianoFigures] = MappingProxyType(
    {
        "dep20": PianoFigures(
            white_width=0.022,
            white_length=0.15,
            white_lever=0.19,
            black_lever=0.12,
            base_height=0.18,
            base_rear_length=0.12,
            base_length=0.295,
            base_width=1.32,
            surface_height=0.14,
        ),
        "nikomaku": PianoFigures(
            white_width=(1.194 - 51 * 0.001) / 52,
            white_length=0.14,
            white_lever=0.17,
            black_lever=0.11,
            base_height=0.085,
            base_rear_length=0.06,
            base_length=0.21,
            base_width=1.21,
            surface_height=0.07,
        ),
    }
)
"""By name: a portable piano, and one of full size, whose keyboard is 1.194 m wide."""


def key_joint_names() -> tuple[str, ...]:
    """Names of the 88 joints, from the lowest key; those of every piano are the same."""
    return tuple(key.joint for key in PIANOS["dep20"].keys)
