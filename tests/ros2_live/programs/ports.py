"""Which of some UDP ports are open at an address, as a stranger can tell: a closed one is reported by its machine.

ports.py ADDRESS PORT...
"""

import json
import socket
import sys

address, *ports = sys.argv[1:]
found = []
for port in map(int, ports):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.settimeout(0.2)
        end.connect((address, port))
        try:
            end.send(b"RTPS")
            end.recv(1)
        except ConnectionRefusedError:
            continue
        except TimeoutError:
            pass
        found.append(port)
print(json.dumps(found))
