#!/bin/bash
# vcan_circle.sh BIN [KEEP]: the paper's circle with tendrild, tendril-plant and an operator as processes of their own on
# a real vcan0, judged from the daemon's log beside the same run in one process. Runs inside tools/vcan-run; logs go to
# the folder KEEP when it is given. Knows the programs only by their command lines.
set -u
bin=$1
tree=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)
robot=$tree/config/robots/rig_60mm.yaml
lcm="udpm://239.255.76.67:7667?ttl=0"
if [ $# -gt 1 ]; then
  work=$2
  mkdir -p "$work"
else
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
fi

give_up() {
  echo "vcan_circle: $1" >&2
  for log in plant daemon follow; do
    [ -s "$work/$log.txt" ] && { echo "--- $log"; tail -n 15 "$work/$log.txt"; } >&2
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

# The controller's file with the bus it finds here.
sed -e 's/^\( *interface:\) *can0.*/\1 vcan0/' -e "s|^robot: *robots/|robot: $tree/config/robots/|" \
  "$tree/config/tendrild.yaml" >"$work/tendrild.yaml"

"$bin/tendril-plant" --robot "$robot" --can vcan0 --lcm "$lcm" >"$work/plant.txt" 2>&1 &
plant=$!
until_true 10 grep -q ready "$work/plant.txt" || give_up "the plant does not start"
"$bin/tendrild" --config "$work/tendrild.yaml" --log "$work/live.lcmlog" >"$work/daemon.txt" 2>&1 &
daemon=$!
until_true 20 mode_is configured || give_up "the daemon does not configure the drives"
"$bin/tendril" send --lcm "$lcm" arm || give_up "the daemon does not arm"
until_true 20 mode_is running || give_up "the robot is not pretensioned"
"$bin/tendril" follow circle --robot "$robot" --lcm "$lcm" >"$work/follow.txt" 2>&1 || give_up "the circle is not followed"
tail -n 1 "$work/follow.txt"
"$bin/tendril" send --lcm "$lcm" disarm || give_up "the daemon does not disarm"
until_true 20 mode_is configured || give_up "the tensions do not go down"

kill -TERM $daemon
wait $daemon || give_up "the daemon ends with exit status $?"
kill -TERM $plant
wait $plant || give_up "the plant ends with exit status $?"
tail -n 2 "$work/plant.txt"

"$bin/tendril" demo --trajectory circle --no-plots --out "$work/demo" >"$work/demo.txt" 2>&1 ||
  give_up "the same run in one process fails: $(tail -n 1 "$work/demo.txt")"
"$bin/vcan_circle_check" "$work/live.lcmlog" "$work/demo/circle/run.lcmlog" "$work/demo/circle/summary.json"
