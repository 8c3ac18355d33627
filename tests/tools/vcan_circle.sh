#!/bin/bash
# vcan_circle.sh BIN [KEEP]: the paper's circle with tendrild, tendril-plant and an operator as processes of their own on
# a real vcan0, judged from the daemon's log beside the same run in one process. Runs inside tools/vcan-run.
source "$(dirname "$(readlink -f "$0")")/live_vcan.sh"

daemon_file "$robot"
start_plant
start_daemon --log "$work/live.lcmlog"
arm
"$bin/tendril" follow circle --robot "$robot" --lcm "$lcm" >"$work/follow.txt" 2>&1 || give_up "the circle is not followed"
tail -n 1 "$work/follow.txt"
disarm
stop $daemon daemon
stop $plant plant
tail -n 2 "$work/plant.txt"

"$bin/tendril" demo --trajectory circle --no-plots --out "$work/demo" >"$work/demo.txt" 2>&1 ||
  give_up "the same run in one process fails: $(tail -n 1 "$work/demo.txt")"
"$bin/vcan_circle_check" "$work/live.lcmlog" "$work/demo/circle/run.lcmlog" "$work/demo/circle/summary.json"
