import sys
from pathlib import Path

# Test modules are imported by file (importlib mode), which leaves sys.path alone; shared samples need a name.
sys.path.append(str(Path(__file__).parent))
