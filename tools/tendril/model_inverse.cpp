// `tendril model inverse | inverse-tip`: from bends and positions to tensions, row by row.
// Knows no equation itself; says on stderr where a target could not be met. A third of it is help.
#include <memory>

#include "commands.h"
#include "model.h"
#include "tendril/core/tip_unit.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/inverse_equilibrium.h"
#include "tendril/model/loading.h"
#include "tension_bounds.h"

namespace tendril::tools {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;

struct InverseOptions {
  MinTensionOption min_tension;
  bool equilibrium = false;
};

void RequireShape(const io::CsvReader& rows, const model::TensionedShape& shape,
                  const std::string& asked = {}) {
  const std::string why = model::WhyNoShape(shape);
  if (!why.empty()) throw rows.Error(fmt::format("{}{}; reduce the target", why, asked));
}

void InverseRows(const RobotParameters& robot, const InverseOptions& options) {
  const Body body(robot.body);
  const TensionBounds bounds = options.min_tension.BoundsOf(robot);
  const int k = body.sections();
  io::CsvReader rows =
      Stdin(io::NumberedPairs("us", "vs", k),
            {io::Columns(io::NumberedPairs("dus", "dvs", k), io::NumberedPairs("ddus", "ddvs", k))});
  io::CsvWriter out(stdout, io::Numbered("T", body.tendons()));
  Unmet unmet;
  model::ArcTensions arcs(body, model::TendonPairs(robot));
  const model::InverseEquilibrium equilibrium(body, bounds.low_N, bounds.high_N, model::TendonPairs(robot));
  while (rows.Next()) {
    const VectorXd bend = Cursor(rows.required()).Take(2 * k);
    const bool moving = rows.has(0);
    Cursor motion(rows.optional(0));
    const VectorXd rate = moving ? motion.Take(2 * k) : VectorXd::Zero(2 * k);
    const VectorXd acceleration = moving ? motion.Take(2 * k) : VectorXd::Zero(2 * k);
    VectorXd q(body.dof());
    body.SpreadBending(bend, q);
    RequireOpenDisks(rows, body, q);
    if (options.equilibrium) {
      const auto shape =
          moving ? equilibrium.ForBending(bend, rate, acceleration) : equilibrium.ForBending(bend);
      RequireShape(rows, shape);
      if (shape.status != Status::kOk) {
        unmet.Add(rows, fmt::format("out of reach between {} and {} N: the nearest bend is {:.6g} rad away",
                                    bounds.low_N, bounds.high_N, shape.target_error));
      }
      out.PutAll(shape.tension_N).EndRow();
      continue;
    }
    const auto result = arcs.Move(bend, rate, acceleration, bounds.low_N, bounds.high_N);
    if (result.status != Status::kOk) {
      unmet.Add(rows, fmt::format("out of reach between {} and {} N: {:.6g} N·m of the force are missing",
                                  bounds.low_N, bounds.high_N, result.residual_Nm));
    }
    out.PutAll(result.tension_N).EndRow();
  }
}

void InverseTipRows(const RobotParameters& robot, const MinTensionOption& min_tension) {
  const Body body(robot.body);
  const TensionBounds bounds = min_tension.BoundsOf(robot);
  const model::InverseEquilibrium equilibrium(body, bounds.low_N, bounds.high_N, model::TendonPairs(robot));
  io::CsvReader rows = Stdin({"x", "y", "z"}, {{"dx", "dy", "dz", "ddx", "ddy", "ddz"}});
  io::CsvWriter out(
      stdout, io::Columns(io::Numbered("T", body.tendons()), io::NumberedPairs("u", "v", body.units())));
  Unmet unmet;
  while (rows.Next()) {
    const Vector3d tip = TipOf(rows);
    const double most = robot.limits.max_bending_rad;
    const bool moving = rows.has(0);
    const VectorXd motion = moving ? Cursor(rows.optional(0)).Take(6) : VectorXd::Zero(6);
    const auto shape = moving ? equilibrium.ForTip(tip, motion.head(3), motion.tail(3), most)
                              : equilibrium.ForTip(tip, most);
    const std::string asked = AskMillimetres(tip, robot.body.length_m());
    RequireShape(rows, shape, asked);
    if (shape.status != Status::kOk) {
      unmet.Add(rows,
                fmt::format("out of reach between {} and {} N: the nearest tip found is {:.6g} m away{}",
                            bounds.low_N, bounds.high_N, shape.target_error, asked));
    }
    // It is one all the same, but the robot may not go there by itself.
    if (!moving && !model::LoadingEndsAt(body, shape.tension_N, shape.q)) {
      unmet.Add(
          rows,
          "this equilibrium does not lie on the branch from zero tension: raising the tensions from rest "
          "ends elsewhere (see `tendril model statics`)");
    }
    out.PutAll(shape.tension_N).PutAll(shape.q).EndRow();
  }
}

}  // namespace

void AddModelInverseCommands(CLI::App& model) {
  auto options = std::make_shared<InverseOptions>();
  CLI::App* inverse = AddBendingEvaluation(
      model, "inverse", "us,vs per section [and dus,dvs,ddus,ddvs] -> T per tendon of least sum (T - Tmin)^2",
      [options](const RobotParameters& robot) { InverseRows(robot, *options); });
  inverse
      ->add_option_function<std::string>(
          "--shape", [options](const std::string& text) { options->equilibrium = text == "equilibrium"; },
          "arc (default) or equilibrium")
      ->check(CLI::IsMember({"arc", "equilibrium"}));
  options->min_tension.AddTo(*inverse);
  inverse->footer(
      "arc: the units of a section share its bend, rates and accelerations equally; the tensions balance "
      "Kane's\nequations projected on that motion, two a section.\nequilibrium: the units bend according to "
      "the forces, and their sums are us,vs. Rates and accelerations, when\ngiven, are shared equally by a "
      "section's units, and every unit's equation of motion holds.\nOut of reach within the tension bounds: "
      "the nearest admissible tensions, and a line on stderr with what is\nmissing.");

  auto tip_options = std::make_shared<MinTensionOption>();
  CLI::App* inverse_tip = AddBendingEvaluation(
      model, "inverse-tip",
      "tip x,y,z [and dx,dy,dz,ddx,ddy,ddz] -> T per tendon and u,v per unit of the true equilibrium with "
      "its tip there",
      [tip_options](const RobotParameters& robot) { InverseTipRows(robot, *tip_options); });
  tip_options->AddTo(*inverse_tip);
  inverse_tip->footer(
      "Tip velocity and acceleration, when given, become section rates of least norm (one section: least "
      "squares),\n"
      "shared equally by its units; every unit's equation of motion holds. Out of reach: the nearest tip "
      "found within\n"
      "the tension bounds, and a line on stderr with the distance.");
}

}  // namespace tendril::tools
