#!/bin/bash
# vcan_commission.sh BIN [KEEP]: the evening with a new arm, with daemon, plant and operator as processes of their own on
# a real vcan0: two drives exchanged, a load cell that is not tared, no tracker, nothing commissioned. Arming is refused,
# commissioning names what is wrong and writes it right, then passes and leaves its record; the robot is homed, armed and
# given a target. Runs inside tools/vcan-run.
source "$(dirname "$(readlink -f "$0")")/../tools/live_vcan.sh"

# COMMAND... must fail and say TEXT.
refused() {
  local text=$1
  shift
  "$@" >"$work/said.txt" 2>&1 && give_up "'$*' was not refused"
  grep -q -- "$text" "$work/said.txt" || give_up "'$*' does not say: $text"
}
commission() { "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm" --yes "$@" </dev/null; }
# at_terminal PROMPT=ANSWER...: commissioning by somebody who types
at_terminal() {
  python3 -B "$tree/tests/tools/at_terminal.py" "$@" -- \
    "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm"
}

cp "$robot" "$work/robot.yaml"
# A cycle of 4 ms: most of the time is waiting for things to settle.
# The law that puts the tip where it is asked for, not the paper's, which leaves it 1.6 mm aside here.
simulated=
daemon_file robot.yaml 's/^\( *cycle_ns:\) .*/\1 4000000/; s/^\( *law:\) paper/\1 equilibrium/'
# The arm itself. Nobody looks at its tip but the operator.
python3 - "$work" <<'ARM' || give_up "the arm's file cannot be made"
import re, sys
text = open(sys.argv[1] + "/robot.yaml").read()
text, exchanged = re.subn(r"(?m)^actuation:.*", r"\g<0>\n  nodes: [2, 1, 3]", text)
text, blind = re.subn(r"(?m)^  tracker:.*\n(?:    .*\n)+", "", text)
assert exchanged == 1 and blind == 1
open(sys.argv[1] + "/arm.yaml", "w").write(text + "\neffects:\n  - {effect: cell_offset, where: tendon:3, N: 0.4}\n")
ARM

sed 's/^commissioning: .*/commissioning: not_required/' "$work/tendrild.yaml" >"$work/not_required.yaml"
refused "set commissioning: required there" "$bin/tendril" commission --config "$work/not_required.yaml" --lcm "$lcm"

start_plant "$work/arm.yaml"
sed -i 's/cycle_every_cycles: 1 /cycle_every_cycles: 20 /' "$work/tendrild.yaml"
start_daemon
refused "publishes one of 20 cycles; .*set lcm.cycle_every_cycles to 1" commission
stop $daemon daemon
sed -i 's/cycle_every_cycles: 20 /cycle_every_cycles: 1 /' "$work/tendrild.yaml"
start_daemon
refused "tendril commission" "$bin/tendril" send --lcm "$lcm" arm
refused "tendril commission" "$bin/tendril" home --lcm "$lcm"
refused "the daemon does not arm: .*never commissioned.* (207); run tendril commission" \
  "$bin/tendril" excite --live --arm --set quick --out "$work/excited" --lcm "$lcm"
sed 's/pull_N: 2.0/pull_N: 3.0/' "$work/tendrild.yaml" >"$work/harder.yaml"
refused "pull_N: 3 is more than the 2 that the daemon runs with" \
  "$bin/tendril" commission --config "$work/harder.yaml" --lcm "$lcm" --yes
timeout --preserve-status -s INT 4 "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm" --yes \
  >"$work/said.txt" 2>&1
grep -q "stopped: the daemon was asked to disarm; nothing was written" "$work/said.txt" || give_up "Ctrl-C is called something else"
mode_is configured || give_up "commissioning was stopped, and the robot is not disarmed"
grep -q "robot.yaml.commissioned is not there" "$work/daemon.txt" || give_up "the daemon's log does not tell why"
refused "each of the 3 tendons" commission --seen 0 120
refused "cancelled before any motor pulled" at_terminal "Ctrl-C to cancel=^C"
refused "no terminal for the confirmation" "$bin/tendril" commission --config "$work/tendrild.yaml" --lcm "$lcm" </dev/null
mode_is configured || give_up "left at the prompt, and something moves"

# Exchanged drives bend the robot to each other's side.
refused "node 1 pulls that one" commission --seen 120 0 240 --write
grep -q "{node_id: 2, tendon: 1}" "$work/tendrild.yaml" || give_up "the node list was not corrected"
grep -q "offset_N" "$work/robot.yaml" || give_up "the zero of the load cell was not written"
[ ! -e "$work/robot.yaml.commissioned" ] || give_up "a wrong rig left a record"
cp "$work/said.txt" "$work/first.txt"
refused "not what the daemon runs with" commission

stop $daemon daemon
start_daemon
at_terminal "Ctrl-C to cancel=" "tendon 1 pulls now=0" "tendon 2 pulls now=120" "tendon 3 pulls now=-120" \
  >"$work/said.txt" 2>&1 || give_up "the corrected rig does not pass"
grep -A5 "^tendon  " "$work/said.txt"
[ -s "$work/robot.yaml.commissioned" ] || give_up "there is no record"
grep -q "{tendon: 3, node_id: 3, serial: 3," "$work/robot.yaml.commissioned" || give_up "the record has no serial numbers"
sed -i.kept 's/serial: 3,/serial: 99,/' "$work/robot.yaml.commissioned"
refused "node 3 (tendon 3) has serial 3, commissioned was 99" "$bin/tendril" home --lcm "$lcm"
grep -q "warning.*node 3 (tendon 3) has serial 3, commissioned was 99" "$work/daemon.txt" || give_up "the log does not name the drive"
mv "$work/robot.yaml.commissioned.kept" "$work/robot.yaml.commissioned"

# Homing that its operator leaves does not go on. (From slack: the tendons were let go by the disarming.)
timeout --preserve-status -s INT 0.7 "$bin/tendril" home --lcm "$lcm" >"$work/said.txt" 2>&1
grep -q "stopped: the daemon was asked to disarm; it is in mode configured" "$work/said.txt" || give_up "Ctrl-C leaves it homing"

# Without a restart.
"$bin/tendril" home --lcm "$lcm" || give_up "the robot is not homed"
mode_is hold || give_up "the robot does not hold"
arm
"$bin/tendril" send --lcm "$lcm" tip 0.015 0 0.0575 || give_up "the tip is not taken"
arrived() {
  "$bin/tendril" status --lcm "$lcm" --json | python3 -c "import json, math, sys
state = json.loads(sys.stdin.readline())
sys.exit(math.dist(state['tip_estimate_W_m'], state['target_tip_W_m']) > 1e-3)"
}
until_true 10 arrived || give_up "the tip does not arrive"
mode_is running || give_up "the robot does not keep running"
disarm
stop $daemon daemon
stop $plant plant
echo "vcan_commission: two exchanged drives and a cell's zero found, corrected, commissioned, homed and armed"
