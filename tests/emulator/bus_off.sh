#!/bin/bash
# bus_off.sh BIN [KEEP]: bus-off of an armed robot whose drives' side then vanishes, so that nobody ever tells of a restart.
# The daemon restarts the bus by itself, boots the drives that come back, and moves nothing until clear and arm. Frames that
# nobody can read are counted meanwhile. Runs inside tools/vcan-run.
source "$(dirname "$(readlink -f "$0")")/../tools/live_vcan.sh"

counted() { timeout 5 "$bin/tendril" status --lcm "$lcm" --watch --json | grep -q "\"$1\":$2[,}]"; }
said() { grep -q "$1" "$work/daemon.txt"; }
booted_again() { [ "$(grep -c "node [123]: configured" "$work/daemon.txt")" -ge 6 ]; }
# frame ID DATA: from somebody who is neither the daemon nor a drive
frame() {
  python3 -c "import socket, struct, sys
with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as s:
    s.bind(('vcan0',))
    data = bytes.fromhex(sys.argv[2])
    s.send(struct.pack('<IB3x8s', int(sys.argv[1], 16), len(data), data))" "$1" "$2"
}

daemon_file "$robot"
start_plant
start_daemon --black-box "$work"
arm

frame 281 37
until_true 5 said "TPDO 0x281 ignored: 1 bytes, 37, expected 2" || give_up "a malformed frame is not told"
sleep 1.1
frame 080 ""
until_true 5 said "SYNC 0x080 came from another sender" || give_up "a foreign SYNC is not told"
counted malformed 1 || give_up "the malformed frame is not counted in the status"
counted foreign 1 || give_up "the foreign SYNC is not counted in the status"
mode_is running || give_up "a malformed frame and a SYNC end the motion"

"$bin/tendril" fault --lcm "$lcm" bus_off || give_up "the fault is not ordered"
until_true 5 mode_is fault || give_up "bus-off is not a fault"
kill -KILL $plant
wait $plant 2>/dev/null
until_true 10 said "restart 1 of 5 requested: the interface runs" || give_up "nobody restarts the bus"
start_plant
until_true 20 booted_again || give_up "the drives are not booted again"
sleep 1
mode_is fault || give_up "the fault does not stay until it is cleared"
"$bin/tendril" send --lcm "$lcm" arm 2>/dev/null && give_up "armed without being cleared"
"$bin/tendril" send --lcm "$lcm" clear || give_up "the fault cannot be cleared"
until_true 20 mode_is configured || give_up "the drives are not ready after clear"
arm

stop $daemon daemon
stop $plant plant
