# live_vcan.sh: sourced by tests that run daemon, plant and operator as processes of their own on a real vcan0; reads the
# arguments BIN [KEEP] (logs go to the folder KEEP when it is given). Knows the programs only by their command lines.
set -u
bin=$1
tree=$(cd "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")/../.." && pwd)
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
  local log
  echo "$(basename "$0" .sh): $1" >&2
  for log in "$work"/*.txt; do
    [ -s "$log" ] && { echo "--- $(basename "$log" .txt)"; tail -n 30 "$log"; } >&2
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
    sleep 0.25
  done
}

# What tells the daemon that the robot needs no commissioning; empty where the test is about that.
simulated=--simulated

# daemon_file ROBOT [SED-SCRIPT]: the controller's file with the bus it finds here
daemon_file() {
  sed -e 's/^\( *interface:\) *can0.*/\1 vcan0/' -e "s|^robot: .*|robot: $1|" -e "${2:-}" \
    "$tree/config/tendrild.yaml" >"$work/tendrild.yaml"
}

mode_is() { "$bin/tendril" status --lcm "$lcm" --json 2>/dev/null | grep -q "\"mode\": *\"$1\""; }

# start_plant [ROBOT]
start_plant() {
  "$bin/tendril-plant" --robot "${1:-$robot}" --can vcan0 --lcm "$lcm" >"$work/plant.txt" 2>&1 &
  plant=$!
  until_true 10 grep -q ready "$work/plant.txt" || give_up "the plant does not start"
}

# start_daemon ARGUMENTS...
start_daemon() {
  "$bin/tendrild" --config "$work/tendrild.yaml" $simulated "$@" >>"$work/daemon.txt" 2>&1 &
  daemon=$!
  until_true 20 mode_is configured || give_up "the daemon does not configure the drives"
}

arm() {
  "$bin/tendril" send --lcm "$lcm" arm || give_up "the daemon does not arm"
  until_true 20 mode_is running || give_up "the robot is not pretensioned"
}

disarm() {
  "$bin/tendril" send --lcm "$lcm" disarm || give_up "the daemon does not disarm"
  until_true 20 mode_is configured || give_up "the tensions do not go down"
}

# stop PROCESS NAME
stop() {
  local late
  kill -TERM "$1"
  { sleep 15; kill -KILL "$1"; } &
  late=$!
  wait "$1" || give_up "the $2 ends with exit status $?"
  kill $late
}
