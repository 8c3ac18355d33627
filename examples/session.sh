#!/bin/sh
# A whole session without hardware: a robot file is checked, the robot is recorded (here a simulated one whose backbone is
# a tenth softer than its file says), the gap is diagnosed, the finding is written into a new file, and a circle is
# followed with both. usage: session.sh [FOLDER]; `tendril` has to be on the PATH.
set -e
here=$(dirname "$(readlink -f "$0")")
out=${1:-session}
robot=$here/my_robot.yaml
mkdir -p "$out"

tendril config check "$robot" >"$out/resolved.yaml"

# The robot as it is. With hardware: tendril excite --live --robot "$robot" --out "$out/runs"
sed -e 's/youngs_modulus_Pa: 3.0e10/youngs_modulus_Pa: 2.7e10/' "$robot" >"$out/as_built.yaml"
tendril excite --robot "$robot" --plant "$out/as_built.yaml" --plan "$here/session_plan.yaml" --out "$out/runs"

tendril gap diagnose --robot "$robot" "$out/runs" --out "$out/gap" --no-next
tendril gap apply --robot "$robot" "$out/gap/report.json" --out "$out/my_robot_found.yaml"
tendril compare --robot "$robot" --robot "$out/my_robot_found.yaml" --plant "$out/as_built.yaml" \
  --trajectory circle --out "$out/compare"
echo "Look at $out/gap/report.html and $out/compare."
