"""The modes as ROS 2 services, on this machine only: `python -m humanoid_sim.ros2_services`.

For the Python of a ROS 2 installation, 3.9 or later: this needs `rclpy`, `std_srvs`, the standard library, and
`client.py`. The two files work without the package, side by side in any folder: `python ros2_services.py`.

A service changes a mode, so none may be reached from another machine. The middleware is configured for the loopback
interface before it starts, its sockets are bound to that device, and where either fails there is no node.
"""

from __future__ import annotations

import os
import sys
import tempfile
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or __package__:
    from humanoid_sim.client import SessionError, ask_sessions, find_session, monotonic_ns, network_on
else:
    from client import SessionError, ask_sessions, find_session, monotonic_ns, network_on

_WORDS = ("damp", "load_a", "load_b", "start_remote", "start_locomotion", "quit")
SERVICES = {f"/humanoid_control/mode/{word}": word for word in _WORDS}
"""Names, and the words that they send to the session."""
_TURN = 0.05  # s that the executor waits for at most
_SUSPENDED, _SETTLE = 0.2, 0.2  # s of a turn beyond which the process was suspended, and for which calls are old then

_FAST_DDS = """\
<?xml version="1.0" encoding="UTF-8"?>
<dds><profiles xmlns="http://www.eprosima.com">
 <transport_descriptors>
  <transport_descriptor>
   <transport_id>loopback</transport_id><type>UDPv4</type>
   <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
  </transport_descriptor>
  <transport_descriptor><transport_id>memory</transport_id><type>SHM</type></transport_descriptor>
 </transport_descriptors>
 <participant profile_name="this_machine" is_default_profile="true"><rtps>
  <userTransports><transport_id>loopback</transport_id><transport_id>memory</transport_id></userTransports>
  <useBuiltinTransports>false</useBuiltinTransports>
 </rtps></participant>
</profiles></dds>
"""
"""Settings of the discovery range (`ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_LOCALHOST_ONLY`) let discovery out; this does
not, and clients with default settings find it."""
_PROFILES_VARIABLES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")  # since Fast DDS 3, before
_CYCLONE_DDS = (
    '<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>'
    "<AllowMulticast>spdp</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
_ELSEWHERE = (
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_ENVIRONMENT_FILE",
    "ROS_DISCOVERY_SERVER",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_SUPER_CLIENT",
)
"""Variables that would have the middleware look for others in places of their own."""


def loopback_environment(middleware: str, profiles: Path) -> Mapping[str, str | None]:
    """Return the environment variables with which a middleware stays on this machine; None for those to unset.

    `profiles` is a file that is written where the middleware reads one. Raises `SessionError` if it cannot be
    restricted.
    """
    variables: dict[str, str | None] = {**dict.fromkeys(_ELSEWHERE), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    if middleware.startswith("rmw_fastrtps"):
        profiles.write_text(_FAST_DDS, encoding="utf-8")
        variables.update(dict.fromkeys(_PROFILES_VARIABLES, str(profiles)))
        return {**variables, "SKIP_DEFAULT_XML_FILE": "1"}  # one of the working folder
    if middleware.startswith("rmw_cyclonedds"):
        return {**variables, "CYCLONEDDS_URI": _CYCLONE_DDS}
    raise SessionError(
        f"RMW_IMPLEMENTATION: {middleware or 'none'} cannot be kept on this machine, expected rmw_fastrtps_cpp or "
        "rmw_cyclonedds_cpp"
    )


def answer(word: str, process: int | None, seen: int | None = None) -> tuple[bool, str]:
    """Return whether an intent is granted, and the text that says so, or why not; arguments as of `ask_sessions`."""
    granted, texts = True, []
    try:
        for _, reply in ask_sessions(word, process, producer="ROS 2 service", seen=seen):
            granted = granted and not isinstance(reply, SessionError) and reply.granted
            texts.append(str(reply) if isinstance(reply, SessionError) else reply.text)
    except SessionError as error:
        return False, str(error)
    return granted, "; ".join(texts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until a signal, or the end of the session that is named; returns the exit status."""
    described = f"Serve the modes of a running session as std_srvs/srv/Trigger on this machine: {', '.join(SERVICES)}"
    parser = ArgumentParser("python -m humanoid_sim.ros2_services", description=described)
    parser.add_argument("--session", type=int, help="process id of the session; default: the only one that runs")
    session = parser.parse_args(arguments).session
    try:
        if session is not None:
            find_session(session)
        with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as folder:
            _serve(session, Path(folder) / "fastdds.xml")
    except (ImportError, SessionError) as error:
        hint = ": source /opt/ros/<distribution>/setup.bash first" if isinstance(error, ImportError) else ""
        print(f"error: {error}{hint}", file=sys.stderr)
        return 2
    return 0


def _serve(session: int | None, profiles: Path) -> None:
    """Run a node on this machine until a signal, or the end of the session that is named."""
    import rclpy  # noqa: PLC0415 - a user's own
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor  # noqa: PLC0415
    from rclpy.utilities import get_rmw_implementation_identifier  # noqa: PLC0415
    from std_srvs.srv import Trigger  # noqa: PLC0415

    for variable, value in loopback_environment(get_rmw_implementation_identifier(), profiles).items():
        os.environ.pop(variable, None)
        if value is not None:
            os.environ[variable] = value
    begun = turn = monotonic_ns()  # a call came after `begun`
    settled = 0
    calls: list[str] = []

    def respond(word: str, response: Any) -> Any:
        calls.append(word)
        response.success, response.message = answer(word, session, begun)
        return response

    try:
        rclpy.init(args=[])
        with network_on("lo"):
            node = rclpy.create_node("mode_services", start_parameter_services=False)
            for name, word in SERVICES.items():
                callback = lambda _, response, word=word: respond(word, response)  # noqa: E731
                node.create_service(Trigger, name, callback)
    except RuntimeError as error:  # of rclpy
        raise SessionError(f"ROS 2 does not start: {str(error).splitlines()[0]}") from None
    except OSError as error:
        raise SessionError(f"the sockets of ROS 2 cannot be bound to the device lo: {error}") from None
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    print(f"services {', '.join(SERVICES)} on this machine, domain {node.context.get_domain_id()}", flush=True)
    try:
        while rclpy.ok() and (session is None or find_session(session)):
            turn, before = monotonic_ns(), turn
            if turn - before > 1e9 * _SUSPENDED:
                settled = turn + round(1e9 * _SETTLE)
            if turn >= settled:
                begun = turn
            executor.spin_once(timeout_sec=_TURN)
            while calls:  # what waited meanwhile is as old: a call from before a damp must not be taken for one after
                calls.clear()
                executor.spin_once(timeout_sec=0.0)
    except (KeyboardInterrupt, ExternalShutdownException, SessionError):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
