#!/bin/bash
# vcan_service.sh BIN [KEEP]: what goes on around a daemon on a real vcan0: an interface that goes down is told from bus-off,
# whoever read the log goes away, LCM's network is away for a while, and a second daemon on the same LCM channels (with a bus
# of its own) starts beside it, or meets it while armed. Nothing moves by a command that two would obey. Runs inside tools/vcan-run.
source "$(dirname "$(readlink -f "$0")")/../tools/live_vcan.sh"

# watch: a look at `tendril status --watch --json` with all that comes once a second
watch() {
  timeout 5 "$bin/tendril" status --lcm "$lcm" --watch --json |
    python3 -c "import json, sys
for line in sys.stdin:
    s = json.loads(line)
    if 'robot' in s and 'statistics' in s: break
$1"
}
said() { grep -q "$1" "$work/${2:-daemon}.txt"; }
arm_is_refused() {
  "$bin/tendril" send --lcm "$lcm" arm >"$work/said.txt" 2>&1 && give_up "armed although two daemons would obey"
  grep -q "another daemon (.*) answers on" "$work/said.txt" || give_up "arm is refused for another reason"
}

# A cycle of 4 ms: most of the time is waiting.
daemon_file "$robot" 's/^\( *cycle_ns:\) .*/\1 4000000/'
cd "$work" || exit 1

# ---- all at once, as a user pastes it ----
"$bin/tendril-plant" --robot "$robot" --can vcan0 --lcm "$lcm" >"$work/plant.txt" 2>&1 &
plant=$!
"$bin/tendrild" --config "$work/tendrild.yaml" --simulated >"$work/daemon.txt" 2>&1 &
daemon=$!
"$bin/tendril" send --lcm "$lcm" arm >"$work/said.txt" 2>&1 || give_up "arm does not wait for daemon and drives"
grep -qF "waiting for a daemon on $lcm (TENDRIL_STATE)" "$work/said.txt" ||
  give_up "what arm waits for is not told"
mode_is running || give_up "arm is done before targets are taken"
disarm
stop $daemon daemon

# ---- an interface that is not there yet ----
: >"$work/waits.txt"
"$bin/tendrild" --config "$work/tendrild.yaml" --simulated --can vcan9 --wait >"$work/waits.txt" 2>&1 &
daemon=$!
until_true 10 said "waiting: CAN interface 'vcan9' does not exist" waits || give_up "it does not say what it waits for"
"$bin/tendril" status --lcm "$lcm" >"$work/said.txt" 2>&1 && give_up "a daemon that waits has a state"
grep -q "does not control anything yet, it is waiting: CAN interface 'vcan9' does not exist; .*ip link add" "$work/said.txt" ||
  give_up "its operator does not hear what is missing"
kill -HUP $daemon
until_true 10 said "SIGHUP refused" waits || give_up "a daemon that waits does not refuse SIGHUP"
kill $daemon
wait $daemon || give_up "a daemon that waits does not stop in order"
said "stopped before it controlled anything" waits || give_up "that it stopped is not told"

echo precious >"$work/run.lcmlog"
start_daemon --black-box boxes --log run.lcmlog
said "log $work/run.lcmlog$" || give_up "where a relative log lies is not told"
grep -q precious "$work/run.lcmlog.1" || give_up "an earlier log is not kept"
said "black box: 10 s before a fault into $work/boxes$" || give_up "where a relative black box lies is not told"
arm
watch "assert s['statistics']['minor_faults'] == 0 and s['statistics']['voluntary_switches'] == 0, s['statistics']
drives = s['statistics']['drives']
assert (s['robot'], s['bus']) == ('rig_60mm', 'vcan0') and 'process $daemon' in s['daemon'], s
assert [(d['node_id'], d['serial'], d['state'], d['error_code']) for d in drives] == [(n, n, 'enabled', 0) for n in (1, 2, 3)]
assert s['statistics']['last_fault'] is None" || give_up "the status does not name robot, bus and drives"

"$bin/tendril" commission --config "$tree/config/tendrild.yaml" --lcm "$lcm" --yes >"$work/said.txt" 2>&1 &&
  give_up "commissions a robot that is armed without"
grep -q "the daemon runs with --simulated" "$work/said.txt" || give_up "commissioning is refused for another reason"

# ---- an interface that goes down ----
ip link set vcan0 down
until_true 5 mode_is fault || give_up "an interface that is down is no fault"
watch "assert s['status'] == 426, s['status']
assert s['statistics']['last_fault']['status'] == 426
assert all(d['state'] == 'unreachable' for d in s['statistics']['drives'])" || give_up "it is not told from bus-off"
said "error: .*426 fault: the CAN interface is down or gone" || give_up "the log does not say so"
said "went bus-off" && give_up "it is called bus-off"
until_true 10 ls "$work"/boxes/*_426_InterfaceDown.lcmlog || give_up "the black box is not where it was said"
ip link set vcan0 up
until_true 10 said "the CAN interface is back" || give_up "the interface that is back is not used"
sleep 2
mode_is fault || give_up "the fault does not stay until it is cleared"
"$bin/tendril" send --lcm "$lcm" clear || give_up "the fault cannot be cleared"
until_true 20 mode_is configured || give_up "the drives are not ready after clear"
rm run.lcmlog
until_true 5 said "run.lcmlog no longer exists: it was deleted" || give_up "a log that is gone is not told"
stop $daemon daemon

# ---- nothing can be sent ----
start_daemon
route=$(ip route show | grep ^224.0.0.0/4)
ip route del 224.0.0.0/4
until_true 10 said "warning: .*LCM message(s) could not be sent" || give_up "what LCM could not send is not told"
ip route add $route
sleep 1
watch "assert s['statistics']['publish_failed'] > 0" || give_up "what LCM could not send is not counted"
arm
disarm
stop $daemon daemon

# ---- whoever read the log goes away ----
rm -f "$work/log"
mkfifo "$work/log"
head -n 1 "$work/log" >"$work/first_line.txt" &
reader=$!
"$bin/tendrild" --config "$work/tendrild.yaml" --simulated 2>"$work/log" &
daemon=$!
wait $reader
grep -q tendrild "$work/first_line.txt" || give_up "the log's reader saw nothing"
until_true 20 mode_is configured || give_up "the daemon ended with its log's reader"
arm
disarm
stop $daemon "daemon without a reader"

# ---- two daemons on the same channels ----
ip link add vcan1 type vcan && ip link set vcan1 up || give_up "no second virtual bus"
"$bin/tendril-plant" --robot "$robot" --can vcan1 --lcm 'udpm://239.255.76.67:7677?ttl=0' >"$work/plant_1.txt" 2>&1 &
plant_1=$!
until_true 10 grep -q ready "$work/plant_1.txt" || give_up "the second plant does not start"
start_daemon
arm
"$bin/tendrild" --config "$work/tendrild.yaml" --simulated --can vcan1 --log run.lcmlog >"$work/second.txt" 2>&1 &&
  give_up "a second daemon starts"
[ -e "$work/run.lcmlog.2" ] && give_up "a second daemon puts the first one's log aside"
said "another daemon (host .*, process $daemon, robot rig_60mm, bus vcan0) answers on TENDRIL_\*" second ||
  give_up "the second daemon does not say why"
mode_is running || give_up "the first one is disturbed"
disarm
stop $daemon daemon

# Neither hears the other at its start: the first is frozen meanwhile. Then the second is armed.
: >"$work/daemon.txt"
sed -i 's/^\( *heartbeat_timeout_ms:\) .*/\1 20000/' "$work/tendrild.yaml"
start_daemon
kill -STOP $daemon
"$bin/tendrild" --config "$work/tendrild.yaml" --simulated --can vcan1 >"$work/second.txt" 2>&1 &
second=$!
until_true 20 mode_is configured || give_up "the second does not start beside a frozen one"
arm
kill -CONT $daemon
until_true 10 said "running -> " second || give_up "the second goes on although two would obey"
until_true 10 mode_is configured || give_up "it does not come to rest"
said "warning: .*process $daemon, .* disarmed, and nothing is armed" second || give_up "the second does not say why"
said "warning: .*process $second, .* disarmed, and nothing is armed" || give_up "the first does not hear the second"
arm_is_refused
said "configured -> armed" && give_up "the first obeyed what was meant for the second"
stop $second "second daemon"
until_true 10 said "process $second, .*is silent" || give_up "the first does not notice that it is alone"
arm
disarm

stop $daemon daemon
stop $plant_1 "second plant"
stop $plant plant
echo "vcan_service: all at once, waiting told, interface down and up, log without reader, two daemons told and kept from moving"
