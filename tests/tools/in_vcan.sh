#!/bin/sh
# in_vcan.sh KERNEL CLOCK SECONDS COMMAND...: a test under tools/vcan-run; exit 77 (skipped) with the reason where no vcan
# can be had. KERNEL uml: user-mode Linux if it is installed, in the virtual time of the library CLOCK, so that the
# result does not depend on what else the machine does, else the machine's kernel; host: only that (sanitizers need more
# address space than user-mode Linux has).
vcan_run=$(dirname "$0")/../../tools/vcan-run
kernel=$1 clock=$2 seconds=$3
shift 3
[ "$kernel" = host ] || "$vcan_run" --kernel uml --check >/dev/null 2>&1 || kernel=host
reason=$("$vcan_run" --kernel $kernel --check 2>&1) || {
  echo "SKIPPED: $reason"
  exit 77
}
[ "$kernel" = host ] && exec "$vcan_run" --kernel host --timeout "$seconds" "$@" </dev/null
exec "$vcan_run" --kernel uml --clock "$clock" --timeout "$seconds" "$@" </dev/null
