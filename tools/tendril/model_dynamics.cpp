// `tendril model accel | mass | energy`: the equations of motion at a state, row by row.
#include "model.h"

namespace tendril::tools {
namespace {

using Eigen::VectorXd;
using model::Body;

void Accelerate(const RobotParameters& robot) {
  const Body body(robot.body);
  Body::Workspace workspace(body);
  const int n = body.dof();
  VectorXd force(n), ddq(n);
  io::CsvReader rows = Stdin(io::Columns(Positions(body), Velocities(body), Tensions(body.tendons())));
  io::CsvWriter out(stdout, StrainColumns(body, "dd"));
  while (rows.Next()) {
    Cursor row(rows.required());
    const VectorXd q = row.Take(n), dq = row.Take(n), tension = row.Take(body.tendons());
    RequireOpenDisks(rows, body, q);
    RequirePulling(rows, tension);
    body.TendonForce(q, tension, force);
    body.ForwardDynamics(q, dq, force, ddq, workspace);
    if (!ddq.allFinite()) throw rows.Error("the accelerations are not finite: the state has extreme values");
    out.PutAll(ddq).EndRow();
  }
}

void Mass(const RobotParameters& robot) {
  const Body body(robot.body);
  Body::Workspace workspace(body);
  const int n = body.dof();
  Eigen::MatrixXd mass(n, n);
  Names columns;
  for (int i = 1; i <= n; ++i) {
    // H111 would be both (1, 11) and (11, 1).
    for (int j = 1; j <= n; ++j) columns.push_back(fmt::format("H{}{}{}", i, n < 10 ? "" : "_", j));
  }
  io::CsvReader rows = Stdin(Positions(body));
  io::CsvWriter out(stdout, columns);
  while (rows.Next()) {
    const VectorXd q = Cursor(rows.required()).Take(n);
    RequireOpenDisks(rows, body, q);
    body.MassMatrix(q, mass, workspace);
    for (int i = 0; i < n; ++i) out.PutAll(mass.row(i));
    out.EndRow();
  }
}

void Energies(const RobotParameters& robot) {
  const Body body(robot.body);
  Body::Workspace workspace(body);
  const int n = body.dof();
  io::CsvReader rows = Stdin(io::Columns(Positions(body), Velocities(body)));
  io::CsvWriter out(stdout, {"kinetic", "elastic", "gravity"});
  while (rows.Next()) {
    Cursor row(rows.required());
    const VectorXd q = row.Take(n), dq = row.Take(n);
    RequireOpenDisks(rows, body, q);
    const model::Energy energy = body.EnergyOf(q, dq, workspace);
    out.Put(energy.kinetic).Put(energy.elastic).Put(energy.gravity).EndRow();
  }
}

}  // namespace

void AddModelDynamicsCommands(CLI::App& model) {
  AddModelEvaluation(
      model, "accel",
      "u,v,du,dv per unit and T per tendon -> ddu,ddv; units that twist or stretch have w or e after v",
      Accelerate);
  AddModelEvaluation(model, "mass", "u,v per unit -> mass matrix, row by row", Mass);
  AddModelEvaluation(model, "energy", "u,v,du,dv per unit -> kinetic, elastic, gravity energy", Energies);
}

}  // namespace tendril::tools
