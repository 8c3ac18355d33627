// `tendril model fk`: where the tip is at a state, row by row.
#include "model.h"
#include "tendril/model/shape_points.h"

namespace tendril::tools {
namespace {

using Eigen::VectorXd;

void ForwardKinematics(const RobotParameters& robot) {
  const model::Body body(robot.body);
  VectorXd length(body.tendons());
  io::CsvReader rows = Stdin(Positions(body));
  io::CsvWriter out(stdout,
                    io::Columns({"x", "y", "z", "qw", "qx", "qy", "qz"}, io::Numbered("L", body.tendons())));
  while (rows.Next()) {
    const VectorXd q = Cursor(rows.required()).Take(body.dof());
    RequireOpenDisks(rows, body, q);
    const model::Pose tip = body.TipPose(q);
    const Eigen::Quaterniond turn = model::UnitQuaternion(tip.R_WA);
    body.TendonLengths(q, length);
    out.PutAll(tip.p_WA).Put(turn.w()).PutAll(turn.vec()).PutAll(length).EndRow();
  }
}

}  // namespace

void AddModelForwardCommand(CLI::App& model) {
  AddModelEvaluation(model, "fk", "u,v[,w][,e] per unit -> tip x,y,z, quaternion, straight tendon lengths",
                     ForwardKinematics);
}

}  // namespace tendril::tools
