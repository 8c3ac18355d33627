#!/bin/bash
# A second tendril-plant on the same interface is refused with one line and status 1; on another interface, and after the
# first has gone, it runs. Knows the program's command line only.
set -u
plant=$1 robot=$2 out=$(mktemp -d)
trap 'kill "$first" 2>/dev/null; rm -rf "$out"' EXIT
"$plant" --robot "$robot" --can vcan0 >"$out/first" 2>&1 & first=$!
for _ in $(seq 100); do grep -q "ready" "$out/first" && break; sleep 0.1; done
grep -q "ready" "$out/first" || { cat "$out/first"; echo "the first plant does not start"; exit 1; }

timeout 10 "$plant" --robot "$robot" --can vcan0 >"$out/second" 2>&1
status=$?
[ $status = 1 ] || { cat "$out/second"; echo "status $status of the second plant, not 1"; exit 1; }
[ "$(wc -l <"$out/second")" = 1 ] && grep -q "another tendril-plant is on vcan0 already (process $first)" "$out/second" ||
  { cat "$out/second"; echo "not the one line"; exit 1; }

kill -INT $first
wait $first || { echo "the first plant did not end well"; exit 1; }
timeout -s INT 1 "$plant" --robot "$robot" --can vcan0 >"$out/third" 2>&1
grep -q "ready" "$out/third" || { cat "$out/third"; echo "a third plant does not start after the first has gone"; exit 1; }
