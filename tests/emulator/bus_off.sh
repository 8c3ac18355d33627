#!/bin/bash
# bus_off.sh BIN: bus-off of an armed robot whose drives' side then vanishes, so that nobody ever tells of a restart. The
# daemon restarts the bus by itself, boots the drives that come back, and moves nothing until clear and arm. Frames that
# nobody can read are counted meanwhile. Runs inside tools/vcan-run; knows the programs only by their command lines.
set -u
bin=$1
tree=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)
robot=$tree/config/robots/rig_60mm.yaml
lcm="udpm://239.255.76.67:7667?ttl=0"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

give_up() {
  echo "bus_off: $1" >&2
  for log in plant daemon; do
    [ -s "$work/$log.txt" ] && { echo "--- $log"; tail -n 20 "$work/$log.txt"; } >&2
  done
  kill $(jobs -p) 2>/dev/null
  exit 1
}

# until_true SECONDS COMMAND...
until_true() {
  local end=$((SECONDS + $1))
  shift
  until "$@"; do
    [ $SECONDS -lt $end ] || return 1
    sleep 0.1
  done
}

mode_is() { "$bin/tendril" status --lcm "$lcm" --json 2>/dev/null | grep -q "\"mode\": *\"$1\""; }
counted() { timeout 5 "$bin/tendril" status --lcm "$lcm" --watch --json | grep -q "\"$1\":$2[,}]"; }
said() { grep -q "$1" "$work/daemon.txt"; }
booted_again() { [ "$(grep -c "node [123]: configured" "$work/daemon.txt")" -ge 6 ]; }
start_plant() {
  "$bin/tendril-plant" --robot "$robot" --can vcan0 --lcm "$lcm" >"$work/plant.txt" 2>&1 &
  plant=$!
  until_true 10 grep -q ready "$work/plant.txt" || give_up "the plant does not start"
}
# frame ID DATA: from somebody who is neither the daemon nor a drive
frame() {
  python3 -c "import socket, struct, sys
with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as s:
    s.bind(('vcan0',))
    data = bytes.fromhex(sys.argv[2])
    s.send(struct.pack('<IB3x8s', int(sys.argv[1], 16), len(data), data))" "$1" "$2"
}

sed -e 's/^\( *interface:\) *can0.*/\1 vcan0/' -e "s|^robot: *robots/|robot: $tree/config/robots/|" \
  "$tree/config/tendrild.yaml" >"$work/tendrild.yaml"
start_plant
"$bin/tendrild" --config "$work/tendrild.yaml" --black-box "$work" >"$work/daemon.txt" 2>&1 &
daemon=$!
until_true 20 mode_is configured || give_up "the daemon does not configure the drives"
"$bin/tendril" send --lcm "$lcm" arm || give_up "the daemon does not arm"
until_true 20 mode_is running || give_up "the robot is not pretensioned"

frame 281 37
until_true 5 said "TPDO 0x281 ignored: 1 bytes, 37, where 2" || give_up "a malformed frame is not told"
sleep 1.1
frame 080 ""
until_true 5 said "SYNC 0x080 came from elsewhere" || give_up "a foreign SYNC is not told"
counted malformed 1 || give_up "the malformed frame is not counted in the status"
counted foreign 1 || give_up "the foreign SYNC is not counted in the status"
mode_is running || give_up "a malformed frame and a SYNC end the motion"

"$bin/tendril" fault --lcm "$lcm" bus_off || give_up "the fault is not ordered"
until_true 5 mode_is fault || give_up "bus-off is not a fault"
kill -KILL $plant
wait $plant 2>/dev/null
until_true 10 said "restart 1 of 5 asked for: the interface runs" || give_up "nobody restarts the bus"
start_plant
until_true 20 booted_again || give_up "the drives are not booted again"
sleep 1
mode_is fault || give_up "the fault does not stay until it is cleared"
"$bin/tendril" send --lcm "$lcm" arm 2>/dev/null && give_up "armed without being cleared"
"$bin/tendril" send --lcm "$lcm" clear || give_up "the fault cannot be cleared"
until_true 20 mode_is configured || give_up "the drives are not ready after clear"
"$bin/tendril" send --lcm "$lcm" arm || give_up "the daemon does not arm again"
until_true 20 mode_is running || give_up "the robot is not pretensioned again"

kill -TERM $daemon
wait $daemon || give_up "the daemon ends with exit status $?"
kill -TERM $plant
wait $plant || give_up "the plant ends with exit status $?"
