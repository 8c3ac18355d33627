// `tendril model statics | frequencies`: equilibria under tensions and the vibrations about them, row by row.
#include <memory>

#include "model.h"
#include "tendril/model/shape_points.h"
#include "tendril/model/statics.h"

namespace tendril::tools {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;

// The stable equilibrium on the branch from zero tension, or the row's error.
VectorXd RequireEquilibrium(const io::CsvReader& rows, const Body& body, const VectorXd& tension_N,
                            const model::TipWrench& tip) {
  const model::Equilibrium found = model::SolveStatics(body, tension_N, tip);
  if (const std::string why = model::WhyNoEquilibrium(found); !why.empty()) throw rows.Error(why);
  return found.q;
}

Names DiskColumns(int disks) {
  Names names;
  for (int disk = 1; disk <= disks; ++disk) {
    for (const char* value : {"x", "y", "z", "qw", "qx", "qy", "qz"})
      names.push_back(fmt::format("{}{}", value, disk));
  }
  return names;
}

void Statics(const RobotParameters& robot, bool disks) {
  const Body body(robot.body);
  io::CsvReader rows = Stdin(Tensions(body.tendons()), {{"fx", "fy", "fz"}, {"mx", "my", "mz"}});
  io::CsvWriter out(stdout, io::Columns(Positions(body), Names{"x", "y", "z"},
                                        disks ? DiskColumns(body.disks()) : Names{}));
  while (rows.Next()) {
    const VectorXd tension = Cursor(rows.required()).Take(body.tendons());
    RequirePulling(rows, tension);
    model::TipWrench tip;
    if (rows.has(0)) tip.force_W_N = Cursor(rows.optional(0)).Take(3);
    if (rows.has(1)) tip.moment_W_Nm = Cursor(rows.optional(1)).Take(3);
    const VectorXd q = RequireEquilibrium(rows, body, tension, tip);
    out.PutAll(q).PutAll(body.TipPose(q).p_WA);
    const std::vector<model::Pose> poses = model::DiskPoses(body, q);
    for (std::size_t disk = 1; disks && disk < poses.size(); ++disk) {
      const Eigen::Quaterniond turn = model::UnitQuaternion(poses[disk].R_WA);
      out.PutAll(poses[disk].p_WA).Put(turn.w()).PutAll(turn.vec());
    }
    out.EndRow();
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
  auto disks = std::make_shared<bool>(false);
  CLI::App* statics =
      AddModelEvaluation(model, "statics",
                         "T per tendon [and fx,fy,fz, mx,my,mz at the tip] -> u,v[,w][,e][,sx,sy] "
                         "per unit and tip x,y,z at the equilibrium "
                         "on the branch from zero tension",
                         [disks](const RobotParameters& robot) { Statics(robot, *disks); });
  statics->add_flag("--disks", *disks,
                    "each disk's position and quaternion too: x1,y1,z1,qw1,qx1,qy1,qz1,x2,..");
  statics->footer(
      "fx,fy,fz [N] and mx,my,mz [N·m] act at the centre of the last disk and keep their direction in the "
      "base "
      "frame.\nAfter each unit's u,v comes w of a backbone that twists, e of one that stretches and sx,sy of "
      "one that "
      "shears.");
  AddModelEvaluation(
      model, "frequencies",
      "T per tendon -> natural frequencies [Hz] about the equilibrium, ascending, without damping",
      Frequencies);
}

}  // namespace tendril::tools
