#!/bin/bash
# vcan_circle.sh BIN [KEEP]: the live session of docs/guides/first-hour.md (tendrild, tendril-plant and an operator as
# processes of their own on a real vcan0), as the page shows it, and judged from the daemon's log beside the same circle
# in one process. Runs inside tools/vcan-run.
source "$(dirname "$(readlink -f "$0")")/live_vcan.sh"

/usr/bin/python3 -B "$tree/tests/docs/run_blocks.py" "$tree/docs/guides/first-hour.md" --kind vcan --keep "$work" \
  --bin "$bin" --source "$tree" || give_up "the session is not as its page says"
tail -n 2 "$work/plant.txt"

"$bin/tendril" demo --trajectory circle --no-plots --out "$work/demo" >"$work/demo.txt" 2>&1 ||
  give_up "the same run in one process fails: $(tail -n 1 "$work/demo.txt")"
"$bin/vcan_circle_check" "$work/live.lcmlog" "$work/demo/circle/run.lcmlog" "$work/demo/circle/summary.json"
