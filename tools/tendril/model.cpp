// `tendril model`: the body's equations evaluated row by row, CSV in, CSV out, so that any other program can
// check them. Knows no equation itself.
#include "model.h"

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <functional>
#include <iostream>
#include <numbers>

#include "commands.h"
#include "number_option.h"
#include "tendril/config/config.h"
#include "tendril/model/simulate.h"
#include "tendril/model/statics.h"

namespace tendril::tools {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;
using Names = std::vector<std::string>;

Names Positions(int units) { return io::NumberedPairs("u", "v", units); }
Names Velocities(int units) { return io::NumberedPairs("du", "dv", units); }
Names Accelerations(int units) { return io::NumberedPairs("ddu", "ddv", units); }
Names Tensions(int tendons) { return io::Numbered("T", tendons); }

io::CsvReader Stdin(Names required, std::vector<Names> optional = {}) {
  return {std::cin, "stdin", std::move(required), std::move(optional)};
}

// Next `count` values of a row.
class Cursor {
 public:
  explicit Cursor(std::span<const double> values) : values_(values) {}
  VectorXd Take(int count) {
    const VectorXd taken = Eigen::Map<const VectorXd>(values_.data(), count);
    values_ = values_.subspan(static_cast<std::size_t>(count));
    return taken;
  }

 private:
  std::span<const double> values_;
};

void Accelerate(const RobotParameters& robot) {
  const Body body(robot.body);
  Body::Workspace workspace(body);
  const int n = body.dof();
  VectorXd force(n), ddq(n);
  io::CsvReader rows =
      Stdin(io::Columns(Positions(body.units()), Velocities(body.units()), Tensions(body.tendons())));
  io::CsvWriter out(stdout, Accelerations(body.units()));
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
  io::CsvReader rows = Stdin(Positions(body.units()));
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
  io::CsvReader rows = Stdin(io::Columns(Positions(body.units()), Velocities(body.units())));
  io::CsvWriter out(stdout, {"kinetic", "elastic", "gravity"});
  while (rows.Next()) {
    Cursor row(rows.required());
    const VectorXd q = row.Take(n), dq = row.Take(n);
    RequireOpenDisks(rows, body, q);
    const model::Energy energy = body.EnergyOf(q, dq, workspace);
    out.Put(energy.kinetic).Put(energy.elastic).Put(energy.gravity).EndRow();
  }
}

// The stable equilibrium on the branch from zero tension, or the row's error.
VectorXd RequireEquilibrium(const io::CsvReader& rows, const Body& body, const VectorXd& tension_N,
                            const Vector3d& tip_force_W_N) {
  const model::Equilibrium found = model::SolveStatics(body, tension_N, tip_force_W_N);
  const double percent = 100 * found.load_fraction;
  switch (found.result) {
    case model::StaticsResult::kConverged:
      return found.q;
    case model::StaticsResult::kBuckled:
      if (found.load_fraction <= 0) {
        throw rows.Error(
            "no stable equilibrium: the robot buckles under its own weight before any tension acts; "
            "make it stiffer, lighter or shorter, or turn gravity");
      }
      throw rows.Error(
          fmt::format("no stable equilibrium: the branch from zero tension buckles at {:.6g} % of the load; "
                      "lower the tensions",
                      percent));
    case model::StaticsResult::kNoSolution:
      break;
  }
  throw rows.Error(
      fmt::format("no equilibrium: the branch from zero tension could be followed only to {:.6g} % of the "
                  "load; lower the tensions",
                  percent));
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

void ForwardKinematics(const RobotParameters& robot) {
  const Body body(robot.body);
  VectorXd length(body.tendons());
  io::CsvReader rows = Stdin(Positions(body.units()));
  io::CsvWriter out(stdout,
                    io::Columns({"x", "y", "z", "qw", "qx", "qy", "qz"}, io::Numbered("L", body.tendons())));
  while (rows.Next()) {
    const VectorXd q = Cursor(rows.required()).Take(body.dof());
    RequireOpenDisks(rows, body, q);
    const model::Pose tip = body.TipPose(q);
    Eigen::Quaterniond turn(tip.R_WA);
    turn.normalize();
    if (turn.w() < 0) turn.coeffs() *= -1;
    body.TendonLengths(q, length);
    out.PutAll(tip.p_WA).Put(turn.w()).PutAll(turn.vec()).PutAll(length).EndRow();
  }
}

struct SimulateOptions {
  std::string initial;
  double step_s = 1e-3, rtol = 1e-10;
};

void SimulateMotion(const RobotParameters& robot, const SimulateOptions& options) {
  const Body body(robot.body);
  const int n = body.dof(), m = body.tendons();
  const Names state = io::Columns(Positions(body.units()), Velocities(body.units()));
  VectorXd q = VectorXd::Zero(n), dq = VectorXd::Zero(n);
  if (!options.initial.empty()) {
    std::ifstream file(options.initial);
    if (!file) throw UsageError(fmt::format("--initial: cannot read '{}'", options.initial));
    io::CsvReader initial(file, options.initial, state, {{"t"}});  // a row of an earlier output will do
    if (!initial.Next()) throw std::runtime_error(options.initial + ": no row with the initial state");
    Cursor row(initial.required());
    q = row.Take(n);
    dq = row.Take(n);
    RequireOpenDisks(initial, body, q);
    if (initial.Next()) throw initial.Error("one row only: the initial state");
  }

  io::CsvReader rows = Stdin(io::Columns({"t"}, Tensions(m)));
  std::vector<double> times, tensions;
  while (rows.Next()) {
    Cursor row(rows.required());
    const double t = row.Take(1)[0];
    const VectorXd tension = row.Take(m);
    RequirePulling(rows, tension);
    if (!times.empty() && t <= times.back()) {
      throw rows.Error(
          fmt::format("t = {} does not come after {}: knots must increase in time", t, times.back()));
    }
    times.push_back(t);
    tensions.insert(tensions.end(), tension.begin(), tension.end());
  }
  io::CsvWriter out(stdout, io::Columns({"t"}, state));
  if (times.empty()) return;
  const auto knots = static_cast<Eigen::Index>(times.size());
  const model::TensionProfile profile{Eigen::Map<const VectorXd>(times.data(), knots),
                                      Eigen::Map<const Eigen::MatrixXd>(tensions.data(), m, knots)};
  model::Simulate(body, profile, q, dq, options.step_s, options.rtol,
                  [&](double t, model::ConstVectorRef q_now, model::ConstVectorRef dq_now) {
                    out.Put(t).PutAll(q_now).PutAll(dq_now).EndRow();
                  });
}

}  // namespace

CLI::App* AddModelEvaluation(CLI::App& model, const std::string& name, const std::string& description,
                             std::function<void(const RobotParameters&)> run) {
  CLI::App* command = model.add_subcommand(name, description);
  auto file = std::make_shared<std::string>();
  command->add_option("--robot", *file, "robot file (config/robots/*.yaml)")->required();
  command->callback([file, run = std::move(run)] { run(config::LoadRobot(*file)); });
  return command;
}

void RequirePulling(const io::CsvReader& rows, const VectorXd& tension_N) {
  for (Eigen::Index j = 0; j < tension_N.size(); ++j) {
    if (tension_N[j] < 0) {
      throw rows.Error(fmt::format("T{} = {} N: tendons only pull; give 0 or more", j + 1, tension_N[j]));
    }
  }
}

void RequireOpenDisks(const io::CsvReader& rows, const Body& body, const VectorXd& q) {
  for (int s = 0; s < body.sections(); ++s) {
    const auto& sections = body.parameters().sections;
    for (int i = body.first_unit(s); i < body.end_unit(s); ++i) {
      const double u = q[2 * i], v = q[2 * i + 1], theta = std::hypot(u, v);
      bool open = theta < 2 * std::numbers::pi;
      for (std::size_t k = static_cast<std::size_t>(s); k < sections.size(); ++k) {
        for (const TendonRoute& t : sections[k].tendons) {
          const double towards = u * std::cos(t.angle_rad) + v * std::sin(t.angle_rad);
          open = open && sections[static_cast<std::size_t>(s)].unit_length_m > t.radius_m * towards;
        }
      }
      if (!open) {
        throw rows.Error(
            fmt::format("unit {} is bent by {:.6g} rad: its disks would cut through each other; bend it less",
                        i + 1, theta));
      }
    }
  }
}

void AddModelCommand(CLI::App& app) {
  CLI::App* model = app.add_subcommand(
      "model", "Evaluate the model row by row: CSV with a header on stdin, CSV on stdout, SI units");
  model->require_subcommand(1);
  AddModelEvaluation(*model, "accel", "u,v,du,dv per unit and T per tendon -> ddu,ddv", Accelerate);
  AddModelEvaluation(*model, "mass", "u,v per unit -> mass matrix, row by row", Mass);
  AddModelEvaluation(*model, "energy", "u,v,du,dv per unit -> kinetic, elastic, gravity energy", Energies);
  AddModelEvaluation(
      *model, "statics",
      "T per tendon [and tip force fx,fy,fz] -> u,v per unit and tip x,y,z at the equilibrium on the "
      "branch from zero tension",
      Statics);
  AddModelEvaluation(
      *model, "frequencies",
      "T per tendon -> natural frequencies [Hz] about the equilibrium, ascending, without damping",
      Frequencies);
  AddModelEvaluation(*model, "fk", "u,v per unit -> tip x,y,z, quaternion, straight tendon lengths",
                     ForwardKinematics);
  AddModelInverseCommands(*model);
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* simulate = AddModelEvaluation(
      *model, "simulate", "t and T per tendon (knots, linear between) -> t, u,v and du,dv per unit",
      [options](const RobotParameters& robot) { SimulateMotion(robot, *options); });
  simulate->add_option(
      "--initial", options->initial,
      "CSV with one row u1,v1,..,du1,dv1,..: the initial state (default: straight, at rest)");
  simulate->add_option("--step", options->step_s, "output step [s]")
      ->capture_default_str()
      ->check(NumberFrom(1e-9, 1e9, "give seconds"));
  simulate->add_option("--rtol", options->rtol, "relative tolerance of the integrator")
      ->capture_default_str()
      ->check(NumberFrom(1e-14, 0.1, "leave it out for the usual"));
}

}  // namespace tendril::tools
