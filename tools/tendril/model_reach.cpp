// `tendril model ik`: the bend that brings the tip to a point, row by row. Says on stderr where it is out of
// reach.
#include "model.h"
#include "tendril/core/tip_unit.h"
#include "tendril/model/inverse.h"

namespace tendril::tools {
namespace {

using model::Body;

void InverseKinematicsRows(const RobotParameters& robot) {
  const Body body(robot.body);
  const model::InverseKinematics ik(body, robot.limits.max_bending_rad);
  io::CsvReader rows = Stdin({"x", "y", "z"});
  io::CsvWriter out(stdout, io::NumberedPairs("us", "vs", body.sections()));
  Unmet unmet;
  BendingVector seed = BendingVector::Zero(2 * body.sections());
  while (rows.Next()) {
    const Eigen::Vector3d tip = TipOf(rows);
    const auto solution = ik.Solve(tip, seed);
    if (solution.status != Status::kOk) {
      unmet.Add(rows, fmt::format("out of reach: the nearest tip is {:.6g} m away{}", solution.distance_m,
                                  AskMillimetres(tip, robot.body.length_m())));
    }
    out.PutAll(solution.us_vs).EndRow();
    seed = solution.us_vs;
  }
}

}  // namespace

void AddModelReachCommand(CLI::App& model) {
  CLI::App* ik = AddBendingEvaluation(model, "ik", "tip x,y,z -> us,vs per section at constant curvature",
                                      InverseKinematicsRows);
  ik->footer(
      "A tip out of reach gets the nearest reachable one (bend up to limits.max_bending_rad per section) and "
      "a line\n"
      "on stderr with the distance. With several sections each row starts from the row before, so that a "
      "path stays\n"
      "on one branch.");
}

}  // namespace tendril::tools
