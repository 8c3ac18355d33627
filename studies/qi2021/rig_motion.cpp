#include "rig_motion.h"

#include <stdexcept>

#include "tendril/experiment/motion_run.h"
#include "tendril/model/arc_tensions.h"
#include "tendril/model/capstan.h"

namespace tendril::qi2021 {

using model::Body;

BendingVector Bend(double theta_rad, double beta_rad) {
  BendingVector b(2);
  b << theta_rad * std::cos(beta_rad), theta_rad * std::sin(beta_rad);
  return b;
}

RobotParameters WithLength(RobotParameters robot, double length_m) {
  const double scale = length_m / robot.body.length_m();
  for (auto& s : robot.body.sections) s.unit_length_m *= scale;
  return robot;
}

TendonVector NeededTensions(const Body& body, const BendingVector& us_vs, double min_tension_N) {
  constexpr double kAnyTension_N = 1e3;
  const auto result = model::ArcTensions(body).Hold(us_vs, min_tension_N, kAnyTension_N);
  if (result.status != Status::kOk) throw std::runtime_error("5: no tensions hold the bend");
  return result.tension_N;
}

double PullLoss(const TransmissionParameters& transmission, double base_N) {
  return model::SolveCapstan(transmission.pulleys, base_N) - base_N;
}

Run Follow(Study& study, const RobotParameters& robot, const std::string& motion_name, bool compensation) {
  experiment::ClosedLoopOptions options{
      .controller_robot = robot, .plant_robot = robot, .daemon = study.Daemon(), .plant = {}, .log_path = ""};
  options.daemon.controller.capstan_compensation = compensation;
  const auto motion = motion::MakeMotion(motion_name, robot);
  experiment::ClosedLoop loop(options);
  const auto guard = [&](const CycleRecord& r) {
    if (r.output.mode == Mode::kFault) {
      throw std::runtime_error(fmt::format("{} at t = {:.3f} s of the {} motion", StatusText(r.output.status),
                                           loop.now_s(), motion_name));
    }
  };
  loop.ArmAndPretension();
  experiment::ApproachStart(loop, *motion, [&](const CycleRecord& r, double) { guard(r); });
  Run run;
  run.min_tension_N = robot.limits.min_tension_N;
  const int tendons = robot.body.tendons();
  experiment::StreamMotion(loop, *motion, [&](const CycleRecord& r, double target_s) {
    guard(r);
    study.Progress(target_s / motion->duration_s());
    if (target_s < motion->judged_from_s() || target_s > motion->judged_until_s()) return;
    Run::Sample s{target_s,
                  BendingVector(2),
                  loop.plant().TipPose().p_WA,
                  motion->TipAt(target_s),
                  r.output.tension_desired_base_N,
                  TendonVector(tendons),
                  TendonVector(tendons)};
    loop.plant().body().SumBending(loop.plant().q(), s.bend_rad);
    for (int j = 0; j < tendons; ++j) {
      const auto& t = loop.plant().tendon()[static_cast<std::size_t>(j)];
      s.base_N[j] = t.tension_base_N;
      s.motor_N[j] = t.tension_motor_N;
    }
    run.samples.push_back(std::move(s));
  });
  return run;
}

void Write(Study& study, const std::string& name, const Run& run, int tendons) {
  Series series = study.OpenSeries(
      name, io::Columns({"t_s", "us_rad", "vs_rad", "tip_x_m", "tip_y_m", "tip_z_m", "wanted_x_m",
                         "wanted_y_m", "wanted_z_m"},
                        io::Numbered("desired_base_N_", tendons), io::Numbered("base_N_", tendons),
                        io::Numbered("motor_N_", tendons)));
  for (std::size_t i = 0; i < run.samples.size(); i += 10) {
    const Run::Sample& s = run.samples[i];
    series.row().Put(s.target_s).PutAll(s.bend_rad).PutAll(s.tip_W_m).PutAll(s.wanted_W_m);
    series.row().PutAll(s.desired_N).PutAll(s.base_N).PutAll(s.motor_N).EndRow();
  }
}

}  // namespace tendril::qi2021
