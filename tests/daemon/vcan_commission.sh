#!/bin/bash
# vcan_commission.sh BIN [KEEP]: the evening with a new arm, with daemon, plant and operator as processes of their own on
# a real vcan0: two drives exchanged, nothing commissioned. Arming is refused, commissioning names the drives and writes
# the right list, then passes and leaves its record; the robot is homed, armed and given a target. Knows the programs only by
# their command lines.
set -u
bin=$1
tree=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)
lcm="udpm://239.255.76.67:7667?ttl=0"
if [ $# -gt 1 ]; then
  work=$2
  mkdir -p "$work"
else
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
fi

give_up() {
  echo "vcan_commission: $1" >&2
  for log in plant daemon said; do
    [ -s "$work/$log.txt" ] && { echo "--- $log"; tail -n 40 "$work/$log.txt"; } >&2
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

# COMMAND... must fail and say TEXT.
refused() {
  local text=$1
  shift
  "$@" >"$work/said.txt" 2>&1 && give_up "'$*' was not refused"
  grep -q -- "$text" "$work/said.txt" || give_up "'$*' does not say: $text"
}

start_daemon() {
  "$bin/tendrild" --config "$work/tendrild.yaml" >>"$work/daemon.txt" 2>&1 &
  daemon=$!
  until_true 20 mode_is configured || give_up "the daemon does not configure the drives"
}
stop_daemon() {
  kill -TERM $daemon
  wait $daemon || give_up "the daemon ends with exit status $?"
}

cp "$tree/config/robots/rig_60mm.yaml" "$work/robot.yaml"
sed -e 's/^\( *interface:\) *can0.*/\1 vcan0/' -e 's|^robot: .*|robot: robot.yaml|' \
  -e 's/^commissioning: .*/commissioning: required/' "$tree/config/tendrild.yaml" >"$work/tendrild.yaml"
# The arm itself: the drives of tendons 1 and 2 are exchanged.
sed 's/^actuation:.*/&\n  nodes: [2, 1, 3]/' "$work/robot.yaml" >"$work/arm.yaml"

"$bin/tendril-plant" --robot "$work/arm.yaml" --can vcan0 --lcm "$lcm" >"$work/plant.txt" 2>&1 &
plant=$!
until_true 10 grep -q ready "$work/plant.txt" || give_up "the plant does not start"
start_daemon
refused "tendril commission" "$bin/tendril" send --lcm "$lcm" arm
refused "tendril commission" "$bin/tendril" home --lcm "$lcm"
grep -q "robot.yaml.commissioned is not there" "$work/daemon.txt" || give_up "the daemon's log does not tell why"

refused "node 1 pulls that one" "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm" --write
grep -q "{node_id: 2, tendon: 1}" "$work/tendrild.yaml" || give_up "the node list was not corrected"
[ ! -e "$work/robot.yaml.commissioned" ] || give_up "a wrong rig left a record"
cp "$work/said.txt" "$work/first.txt"
refused "not what the daemon runs with" "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm"

stop_daemon
start_daemon
"$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm" >"$work/said.txt" 2>&1 ||
  give_up "the corrected rig does not pass"
grep -A5 "^tendon  " "$work/said.txt"
[ -s "$work/robot.yaml.commissioned" ] || give_up "there is no record"

# Without a restart.
"$bin/tendril" home --lcm "$lcm" || give_up "the robot is not homed"
mode_is hold || give_up "the robot does not hold"
"$bin/tendril" send --lcm "$lcm" arm || give_up "the daemon does not arm"
"$bin/tendril" send --lcm "$lcm" tip 0.015 0 0.0575 || give_up "the tip is not taken"
sleep 3
mode_is running || give_up "the robot does not follow"
"$bin/tendril" send --lcm "$lcm" disarm || give_up "the daemon does not disarm"
until_true 20 mode_is configured || give_up "the tensions do not go down"
stop_daemon
kill -TERM $plant
wait $plant || give_up "the plant ends with exit status $?"
echo "vcan_commission: two exchanged drives found, corrected, commissioned, homed and armed"
