// `tendril model simulate`: the motion under given tensions, integrated.
#include <fstream>
#include <memory>

#include "commands.h"
#include "model.h"
#include "number_option.h"
#include "tendril/model/simulate.h"

namespace tendril::tools {
namespace {

using Eigen::VectorXd;
using model::Body;

struct SimulateOptions {
  std::string initial;
  double step_s = 1e-3, rtol = 1e-10;
};

void SimulateMotion(const RobotParameters& robot, const SimulateOptions& options) {
  const Body body(robot.body);
  const int n = body.dof(), m = body.tendons();
  const Names state = io::Columns(Positions(body), Velocities(body));
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

void AddModelSimulateCommand(CLI::App& model) {
  auto options = std::make_shared<SimulateOptions>();
  CLI::App* simulate = AddModelEvaluation(
      model, "simulate",
      "t and T per tendon (knots, linear between) -> t, u,v[,w][,e] and du,dv[,dw][,de] per unit",
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
