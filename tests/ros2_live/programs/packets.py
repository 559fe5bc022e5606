"""Count the UDP packets that arrive at a device from an address, until a line comes in: packets.py DEVICE ADDRESS"""

import select
import socket
import sys

ETHERNET, ALL, IPV4, UDP = 14, 3, b"\x08\x00", 17
device, address = sys.argv[1:]
end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL))
end.bind((device, 0))
print("ready", flush=True)
count = 0
while end in select.select([end, sys.stdin], [], [])[0]:
    packet = end.recv(65536)
    source = packet[ETHERNET + 12 : ETHERNET + 16]
    count += packet[12:14] == IPV4 and packet[ETHERNET + 9] == UDP and source == socket.inet_aton(address)
print(count)
