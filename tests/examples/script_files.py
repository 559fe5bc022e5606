"""Scripts that lie in no package."""

import importlib.util
import sys


def load_script(path):
    """A script as a module; not its `main`."""
    spec = importlib.util.spec_from_file_location(f"script_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses and the texts of options are looked up
    spec.loader.exec_module(module)
    return module
