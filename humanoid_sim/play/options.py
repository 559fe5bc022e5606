"""The options of `play`. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

NO_POLICY = "none"


@dataclass(frozen=True)
class PlayConfig:
    """Run a policy on a robot through the five-mode FSM.

    Without options the sample policy moves the simulated Lite arms, walked there by itself: DAMP, LOAD_A,
    START_LOCOMOTION, DAMP. With --manual or --script the FSM is yours.
    """

    policy: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="POLICY")] = ()
    """ONNX checkpoint (FILE.onnx), a shipped policy, 'placeholder' (which answers zeros) or 'none'. Several may be
    given; the first is selected at the start. Default: the robot's sample policy; on hardware none."""
    contract: Annotated[str | None, tyro.conf.arg(metavar="FILE.yaml")] = None
    """A contract.yaml with what the only checkpoint does not say about itself. Default: the one beside it."""
    motion: str | None = None
    """Motion to follow: a sample motion, such as wave, or an .mcap file; of a piano policy a sample song, such as
    ode_to_joy, or a MIDI file (.mid). Default with the sample policies: wave, and ode_to_joy."""
    robot: str = "lite"
    """A shipped robot, robot_descriptions:NAME for a public one, such as robot_descriptions:g1, or the path
    of a robot's YAML file or of an MJCF."""
    command: Annotated[str, tyro.conf.arg(metavar="VX,VY,WZ")] = "0,0,0"
    """Velocity command vx,vy,wz in m/s, m/s and rad/s, of a policy that walks."""
    hardware: Annotated[str | None, tyro.conf.arg(metavar="CHANNELS")] = None
    """CAN channels of a real robot, such as can0, can0,can1 or udp_multicast:239.74.163.2; virtual:NAME emulates the
    motors in this process. Default: simulation."""
    calibration: Annotated[str | None, tyro.conf.arg(metavar="FILE.yaml")] = None
    """The real robot's calibration. Default: calibration.yaml in this folder; none where the motors' own zeros are the
    joints', as those of emulated motors are."""
    allow_no_timeout: bool = False
    """On hardware: drive motors too that nothing stops when this program or its computer dies, such as Sito's."""
    dry_run: bool = False
    """On hardware: do everything but enable the motors, print what was checked, and end."""
    yes: bool = False
    """On hardware: enable the motors without asking first."""
    can_timeout: Annotated[float, tyro.conf.arg(metavar="SECONDS")] = 0.1
    """s without a command after which each motor of a real robot stops by itself, and its joint falls."""
    accept_firmware: Annotated[tuple[str, ...], tyro.conf.arg(metavar="VERSION")] = ()
    """Versions of motor firmware that no document mentions, such as 0.5.3.12, to be driven all the same."""
    allow_script: bool = False
    """Let --script move a real robot, with nobody at the keys."""
    imu: str = "none"
    """IMU of a real robot: none, or microstrain:PORT, or microstrain:PORT@BAUD. Emulated motors bring their own."""
    viewer: Literal["auto", "none", "native", "rerun"] = "auto"
    """MuJoCo's window, or rerun's viewer, in a process of its own; auto opens MuJoCo's window where there is a display,
    but none on hardware."""
    console: bool = False
    """Start the console, the operator's page for a browser on this machine."""
    record: Annotated[str, tyro.conf.arg(metavar="FILE.mcap")] = "auto"
    """Recording (.mcap); auto names it after the time, in the folder runs; none for no recording."""
    overwrite: bool = False
    """Replace files named by --record, --html, --video or --summary that exist."""
    gamepad: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[MAPPING.yaml]")] = None
    """Drive the FSM with a gamepad, of the usual layout or of the one in MAPPING.yaml. On a real bus one must be there,
    asked for or not; with --hardware its loss damps the robot."""
    no_gamepad: bool = False
    """On a real bus: do without a gamepad."""
    dds: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[INTERFACE]")] = None
    """Start the DDS bridge: ROS 2's topics on this machine's loopback interface, and commands for REMOTE from there.
    INTERFACE, such as eth1, starts a second one for another computer: anybody on that network can command REMOTE."""
    remote: Literal["none", "gravity"] = "none"
    """Producer of commands for REMOTE that is started too; gravity compensates gravity, as a process with a model of
    its own."""
    duration: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None
    """Seconds on the robot's clock after which the run ends. Default: when the motion or the script ends."""
    manual: bool = False
    """Drive the FSM yourself, from the keyboard, or with --console or --gamepad from there."""
    script: str | None = None
    """Drive the FSM by a script, such as "damp; load_b; wait; start_remote; hold 5; damp"."""
    watchdog: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME:SECONDS")] = ()
    """Sources of safety statuses, other programs on this machine, that must report at least every SECONDS: the robot is
    damped while one is silent."""
    pace: Literal["auto", "realtime", "fast"] = "auto"
    """Keep real time, or run as fast as possible; auto is fast when nobody watches or drives."""
    html: Annotated[str, tyro.conf.arg(metavar="FILE.html")] = "auto"
    """Page (.html) that replays the run in 3D in any browser, offline; auto writes one of a simulation that nobody
    watches, beside the recording; none for no page."""
    video: Annotated[str | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Video of the run (.mp4); needs OpenGL."""
    summary: Annotated[str | None, tyro.conf.arg(metavar="FILE.json")] = None
    """The final table as JSON."""

    @property
    def has_policy(self) -> bool:
        """True if a policy runs from the beginning; on hardware only one that is named."""
        return self.policy[:1] != (NO_POLICY,) and (bool(self.policy) or self.hardware is None)

    @property
    def has_keys(self) -> bool:
        """True if an operator drives from the keyboard: with --manual, where standard input is a terminal."""
        return self.manual and bool(sys.stdin and sys.stdin.isatty())

    @property
    def is_real_bus(self) -> bool:
        """True if the motors may be real ones."""
        return self.hardware is not None and not self.hardware.startswith(("virtual:", "udp_multicast:"))

    @property
    def needs_gamepad(self) -> bool:
        """True if a gamepad takes part: where one was requested, and on a real bus unless it was declined."""
        return self.gamepad is not None or (self.is_real_bus and not self.no_gamepad and not self.dry_run)
