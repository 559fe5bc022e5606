"""The options of `play`. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

__all__ = ["DEFAULT_ROBOT", "PlayConfig"]

DEFAULT_ROBOT = "lite"


@dataclass(frozen=True)
class PlayConfig:
    """Run a policy on a robot through the five-mode FSM.

    Without options the sample policy moves the simulated Lite arms, walked there by itself: DAMP, LOAD_A,
    START_LOCOMOTION, DAMP. With --manual or --script the FSM is yours.
    """

    policy: str | None = None
    """ONNX checkpoint; 'placeholder' for a policy that answers zeros. Default: the sample policy."""
    contract: str | None = None
    """A contract.yaml with what the checkpoint does not say about itself. Default: the one beside the checkpoint."""
    motion: str | None = None
    """Motion to follow: an .mcap file, or the name of a sample motion. Default with the sample policy: wave."""
    song: str | None = None
    """Song of a piano policy: a sample song's name, or a MIDI file (.mid). Default with the sample policy:
    ode_to_joy."""
    again: str | None = None
    """A recording (.mcap) of play, or of a failure that regress found, whose policy to play again on the same robot,
    with the same motion or command. Options override the recording's."""
    branch: str | None = None
    """FILE@SECONDS: begin a simulation in that instant of a recording (.mcap) of play, and go on with what it took in,
    or with another --policy, --contract (gains), --motion, --command, --script, --manual or --push."""
    shadow: str | None = None
    """ONNX checkpoint that only looks on: while the robot is in DAMPING or STANDBY it runs on the real state, and what
    it sees, answers and would command is recorded. Nothing of it reaches a motor, and no other policy runs; --contract,
    --motion and --command are its."""
    robot: str = DEFAULT_ROBOT
    """A shipped robot (lite, lite_neck, lite_biped, lite_piano, lite_sito), or the path of a robot's YAML file
    or of an MJCF."""
    imu_site: str | None = None
    """Site or body of the robot's MJCF that is its IMU, in simulation. Default: the robot's; of an MJCF its gyro's."""
    command: str = "0,0,0"
    """Velocity command vx,vy,wz in m/s, m/s and rad/s, of a policy that walks."""
    yaw: float = 0.0
    """Heading in rad at which a free-standing robot starts, in simulation."""
    base_height: float | None = None
    """Height in m at which a free-standing robot is held until its policy starts. Default: the robot's."""
    hardware: str | None = None
    """CAN channels of a real robot, such as can0, can0,can1 or udp_multicast:239.74.163.2; virtual:NAME emulates the
    motors in this process. Default: simulation."""
    calibration: str | None = None
    """The real robot's calibration. Default: calibration.yaml in this folder; none where the motors' own zeros are the
    joints', as those of emulated motors are."""
    allow_no_timeout: bool = False
    """On hardware: drive motors too that nothing stops when this program or its computer dies, such as Sito's."""
    dry_run: bool = False
    """On hardware: do everything but enable the motors, print what was checked, and end."""
    yes: bool = False
    """On hardware: enable the motors without asking first."""
    host_id: int = 253
    """This host's id on the CAN buses of a real robot: above every motor's, and that which its motors answer."""
    can_timeout: float = 0.1
    """s without a command after which each motor of a real robot stops by itself, and its joint falls."""
    accept_firmware: tuple[str, ...] = ()
    """Versions of motor firmware that no document mentions, such as 0.5.3.12, to be driven all the same."""
    allow_script: bool = False
    """Let --script move a real robot, with nobody at the keys."""
    imu: str = "none"
    """IMU of a real robot: none, or microstrain:PORT, or microstrain:PORT@BAUD. Emulated motors bring their own."""
    imu_mounting: str = "0,1,0,0"
    """The IMU's own axes in the robot's IMU frame, as a quaternion w,x,y,z. Default: label up, x forward."""
    viewer: Literal["auto", "none", "native", "rerun"] = "auto"
    """MuJoCo's window, or rerun's viewer, in a process of its own; auto opens MuJoCo's window where there is a display,
    but none on hardware."""
    console: bool = False
    """Start the console, a page for the operator, for browsers on this machine; prints its address."""
    record: str = "auto"
    """Recording (.mcap); auto names it after the time, in the folder runs; none for no recording."""
    overwrite: bool = False
    """Replace files named by --record, --video, --snapshot or --summary that exist."""
    gamepad: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Drive the FSM with a gamepad. On a real bus one must be there, asked for or not; with --hardware its loss damps
    the robot."""
    no_gamepad: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """On a real bus: do without a gamepad."""
    dds: bool = False
    """Start the DDS bridge: ROS 2's topics on this machine's loopback interface, and commands for REMOTE from there."""
    dds_interface: str | None = None
    """Start a second bridge for another computer, at this network interface, such as eth1: joint states, IMU, mode,
    description and transforms go out, commands for REMOTE come in. Whoever is on that network can send some."""
    midi: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[PORT]")] = None
    """Take the keys that are down from a MIDI keyboard, for a piano policy whose robot does not know them itself.
    PORT is part of its port's name, the path of a raw MIDI device such as /dev/snd/midiC1D0, or virtual: the keyboard
    of the piano that --hardware virtual:NAME emulates."""
    foxglove: bool = False
    """Start a live server for Foxglove on this machine, which shows, and damps."""
    foxglove_control: bool = False
    """Start it with services for all intents: every page open in a browser on this machine can then move the robot."""
    remote: Literal["none", "gravity"] = "none"
    """Producer of commands for REMOTE that is started too; gravity compensates gravity, as a process with a model of
    its own."""
    gravity_form: Literal["effort", "pd"] = "effort"
    """How gravity compensation commands: as feed-forward effort, or as a PD position offset."""
    duration: float | None = None
    """Seconds on the robot's clock after which the run ends. Default: when the motion or the script ends."""
    policy_seconds: float | None = None
    """Seconds for which the policy drives the robot where nobody drives the FSM. Default: until its motion ends; 10
    for a policy that follows none."""
    action_limit: float | None = None
    """Largest magnitude of a raw action; beyond it the policy has failed, and the robot is damped. Default: the
    contract's action_limit, or else 100."""
    manual: bool = False
    """Drive the FSM yourself, from the keyboard; with --console or --gamepad from there, where there is no terminal."""
    script: str | None = None
    """Drive the FSM by a script, such as "damp; load_b; wait; start_remote; hold 5; damp"."""
    pose: Literal["a", "b"] = "a"
    """Standby pose to walk through when the FSM is driven automatically."""
    inject: tuple[str, ...] = ()
    """Faults to inject, each as FAULT@SECONDS: nan_policy, safety, silent_remote."""
    push: tuple[str, ...] = ()
    """Pushes of a free-standing robot's base, in simulation, each as VX,VY@SECONDS: within 0.1 s it is given this
    velocity in m/s, in the world's axes."""
    pace: Literal["auto", "realtime", "fast"] = "auto"
    """Keep real time, or run as fast as possible; auto is fast when nobody watches or drives."""
    video: str = "auto"
    """Video of the run (.mp4); auto makes one of a simulation where there is no display; none for no video."""
    snapshot: str | None = None
    """Picture of the robot at the end of the motion (.png)."""
    summary: str | None = None
    """The final table as JSON."""
    actuation: Literal["qfrc_applied", "affine", "implicit"] = "qfrc_applied"
    """How the simulated motors run the MIT law: at every physics step in Python, or as MuJoCo's own actuators, which
    agree with that, or, with longer steps and implicit damping, come close to it."""
    control_frequency: float | None = None
    """Hz; default: the robot's, for simulation and for hardware."""
    physics_timestep: float | None = None
    """s; default: the robot's."""
    command_delay: float = 0.0
    """s from writing a command to the motors' obeying it, in simulation."""
    state_delay: float = 0.0
    """s from a joint's state to its being read, in simulation."""
    state_sampling: Literal["now", "on_command"] = "now"
    """When the simulated joints are sampled: at reading, or, as on a CAN bus, at the last command."""

    @property
    def checkpoint(self) -> str | None:
        """The checkpoint that runs, as the robot's policy or as its shadow; None for the sample policy."""
        return self.policy if self.shadow is None else self.shadow
