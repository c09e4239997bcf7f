"""Echoes UDP packets; given an address, pings that echo server and prints the losses and mean round trip [s]."""

import socket
import sys
import time

PORT, COUNT, PATIENCE = 9000, 40, 0.5
sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
if len(sys.argv) == 1:
    sock.bind(("0.0.0.0", PORT))
    print("up", flush=True)
    while True:
        sock.sendto(*sock.recvfrom(100))
sock.settimeout(PATIENCE)
times = []
for number in range(COUNT):
    began = time.monotonic()
    sock.sendto(bytes([number]), (sys.argv[1], PORT))
    try:
        while sock.recv(100) != bytes([number]):
            continue
    except TimeoutError:
        continue
    times.append(time.monotonic() - began)
print(COUNT - len(times), sum(times) / max(1, len(times)))
