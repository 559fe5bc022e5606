"""What every test shares: Hypothesis profiles, and a fixture that fails a test which leaves something open."""

import gc
import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from tyro._parsers import ParserSpecification
from tyro._singleton import MISSING_NONPROP

# Test modules are imported by file (importlib mode), which leaves sys.path alone; what they share needs a name, and one
# that no other module of the tests has.
_HERE = Path(__file__).parent
sys.path += sorted({str(path.parent) for path in _HERE.glob("*/**/*.py")})

# dm_control settles PyOpenGL's platform for the whole process when it is imported; the tests of drawing want OSMesa.
os.environ.setdefault("PYOPENGL_PLATFORM", "osmesa")
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # as the package does before it imports ONNX Runtime
# Workers share few cores, and threads of PyTorch and BLAS spin while they wait for one another: ten times the time.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Shared machines miss any deadline now and then. The normal run is the same everywhere and every time; new examples are
# drawn by `make soak`, and by `pytest --hypothesis-profile explore`. Both print what reproduces a failure.
settings.register_profile("normal", max_examples=30, deadline=None, derandomize=True, database=None, print_blob=True)
settings.register_profile(
    "explore",
    deadline=None,
    print_blob=True,
    max_examples=2000,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("normal")


def pytest_addoption(parser):
    parser.addoption(
        "--complete",
        action="store_true",
        help="soak: the long runs",
    )


def pytest_configure():
    """Make tyro look at each program's options once, and not for each of a thousand command lines: 50 ms for `play`."""
    real, known = ParserSpecification.from_callable_or_type, {}

    def once(f, **options):
        if options["parent_classes"] or options["default_instance"] is not MISSING_NONPROP:
            return real(f, **options)
        if f not in known:
            known[f] = real(f, **options)
        return known[f]

    ParserSpecification.from_callable_or_type = staticmethod(once)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Keep modules and tests, which stay, out of garbage collection: `no_leaks` collects where it suspects a leak."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


_PATIENCE = 20.0
"""s that threads get to end after a test."""

_CACHES = ("mesa_shader_cache", "fontconfig", "mpl-data/fonts", "/dev/", "/proc/", "/sys/")
"""Opened once by graphics drivers and Matplotlib, and left open for good."""


def _open_files():
    """Descriptor and target of every open file and socket of this process; empty where the system cannot tell."""
    found = {}
    try:
        descriptors = os.listdir("/proc/self/fd")
    except OSError:
        return {}
    for name in descriptors:
        try:
            target = os.readlink(f"/proc/self/fd/{name}")
        except OSError:  # the descriptor of this very listing
            continue
        if target.startswith(("/", "socket:")) and not any(cache in target for cache in _CACHES):
            found[int(name)] = target
    return found


def _open_buses():
    """Names of the open channels of python-can's virtual bus, if it was ever imported."""
    virtual = sys.modules.get("can.interfaces.virtual")
    return {str(name) for name, queues in virtual.channels.items() if queues} if virtual else set()


def _leaks(threads, files, buses):
    found = [f"thread '{thread.name}'" for thread in threading.enumerate() if thread not in threads]
    found += [f"file {target}" for number, target in _open_files().items() if files.get(number) != target]
    return found + [f"bus '{name}'" for name in sorted(_open_buses() - buses)]


@pytest.fixture(autouse=True)
def no_leaks():
    """Fail a test that leaves a thread running, a file, a socket or a bus open, or MuJoCo's log behind."""
    before = set(threading.enumerate()), _open_files(), _open_buses()
    log = Path.cwd() / "MUJOCO_LOG.TXT"  # where a warning of MuJoCo goes that nobody has silenced
    had_log = log.exists()
    yield
    if log.exists() and not had_log:
        pytest.fail(f"left behind {log}: {log.read_text()}", pytrace=False)
    leaks = _leaks(*before)
    if leaks:
        gc.collect()  # what a reference cycle kept open warns by itself
        deadline = time.monotonic() + _PATIENCE
        while leaks and time.monotonic() < deadline:
            time.sleep(0.01)
            leaks = _leaks(*before)
    if leaks:
        pytest.fail(f"left open: {', '.join(leaks)}", pytrace=False)


@pytest.fixture
def runtime(monkeypatch):
    """The folder that sessions and their clients meet in: empty, and short, as paths of sockets have to be."""
    with tempfile.TemporaryDirectory(prefix="hs-", ignore_cleanup_errors=True) as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


@pytest.fixture
def local(runtime):
    """A `LocalSession`: feed and intake of this process, driven tick by tick."""
    from local_session import LocalSession  # noqa: PLC0415 - most tests need none of what it imports

    session = LocalSession()
    with session.stack:
        yield session


@pytest.fixture
def near_ends(monkeypatch):
    """Looks three minutes ahead for the end of a motion in a graph, not half an hour, which takes half a second."""
    monkeypatch.setattr("humanoid_sim.policy.graph_motion._LONGEST", 9_000)


@pytest.fixture
def hopper(tmp_path):
    """The MJCF of a small robot, as a user would bring it: no description beside it. May be changed."""
    return Path(shutil.copy(_HERE / "data" / "hopper.xml", tmp_path))
