// `tendril model statics | frequencies`: equilibria under tensions and the vibrations about them, row by row.
#include "model.h"
#include "tendril/model/statics.h"

namespace tendril::tools {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;

// The stable equilibrium on the branch from zero tension, or the row's error.
VectorXd RequireEquilibrium(const io::CsvReader& rows, const Body& body, const VectorXd& tension_N,
                            const Vector3d& tip_force_W_N) {
  const model::Equilibrium found = model::SolveStatics(body, tension_N, tip_force_W_N);
  if (const std::string why = model::WhyNoEquilibrium(found); !why.empty()) throw rows.Error(why);
  return found.q;
}

void Statics(const RobotParameters& robot) {
  const Body body(robot.body);
  io::CsvReader rows = Stdin(Tensions(body.tendons()), {{"fx", "fy", "fz"}});
  io::CsvWriter out(stdout, io::Columns(Positions(body.units()), Names{"x", "y", "z"}));
  while (rows.Next()) {
    const VectorXd tension = Cursor(rows.required()).Take(body.tendons());
    RequirePulling(rows, tension);
    const Vector3d tip_force = rows.has(0) ? Vector3d(Cursor(rows.optional(0)).Take(3)) : Vector3d(0, 0, 0);
    const VectorXd q = RequireEquilibrium(rows, body, tension, tip_force);
    out.PutAll(q).PutAll(body.TipPose(q).p_WA).EndRow();
  }
}

void Frequencies(const RobotParameters& robot) {
  const Body body(robot.body);
  io::CsvReader rows = Stdin(Tensions(body.tendons()));
  io::CsvWriter out(stdout, io::Numbered("f", body.dof()));
  while (rows.Next()) {
    const VectorXd tension = Cursor(rows.required()).Take(body.tendons());
    RequirePulling(rows, tension);
    const VectorXd q = RequireEquilibrium(rows, body, tension, Vector3d::Zero());
    const VectorXd frequencies = model::NaturalFrequencies(body, q, tension, Vector3d::Zero());
    if (!(frequencies[0] > 0)) throw rows.Error("no frequencies: the equilibrium is at the edge of buckling");
    out.PutAll(frequencies).EndRow();
  }
}

}  // namespace

void AddModelStaticsCommands(CLI::App& model) {
  AddModelEvaluation(
      model, "statics",
      "T per tendon [and tip force fx,fy,fz] -> u,v per unit and tip x,y,z at the equilibrium on the "
      "branch from zero tension",
      Statics);
  AddModelEvaluation(
      model, "frequencies",
      "T per tendon -> natural frequencies [Hz] about the equilibrium, ascending, without damping",
      Frequencies);
}

}  // namespace tendril::tools
