"""Count the UDP packets that arrive at a device from an address; each line that comes in asks how many.

packets.py DEVICE ADDRESS
"""

import select
import socket
import sys

ETHERNET, ALL, IPV4, UDP = 14, 3, b"\x08\x00", 17
device, address = sys.argv[1:]
end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL))
end.bind((device, 0))
print("ready", flush=True)
count = 0
while True:
    ready, _, _ = select.select([end, sys.stdin], [], [])
    if end in ready:
        packet = end.recv(65536)
        source = packet[ETHERNET + 12 : ETHERNET + 16]
        count += packet[12:14] == IPV4 and packet[ETHERNET + 9] == UDP and source == socket.inet_aton(address)
    elif sys.stdin.readline():
        print(count, flush=True)
    else:
        break
