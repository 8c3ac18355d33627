// The paper's claims about its experiments: 5.1 (Fig. 11), 5.2 (Fig. 13) and 6. Needed tensions from the
// model, what the rig does from the whole closed loop in simulated time.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "paths.h"
#include "study.h"
#include "tendril/config/config.h"
#include "tendril/experiment/motion_run.h"
#include "tendril/model/capstan.h"
#include "tendril/model/inverse.h"
#include "tendril/model/statics.h"

namespace tendril::tools::reproduce {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;
using nlohmann::ordered_json;
constexpr double kPi = std::numbers::pi;

constexpr double kPlanarBend_rad = 1.6, kPlanarLoss_N = 1.26, kPlanarRate_radps = 0.26;  // 5.1
constexpr double kCircleLoss_N = 0.42, kCircleBend_rad = kPi / 3;                        // 5.2
constexpr double kWireRadius_m = 0.0004;  // section 5: a wire of 0.8 mm diameter; table 1: a radius of 0.5 mm
// "Negligible" is not defined by the paper; a twentieth of what is needed is generous.
constexpr double kNegligible = 0.05;

RobotParameters Rig(const char* file) { return config::LoadRobot(ConfigFile(file)); }

/// The robot with another total length, its units equally long.
RobotParameters WithLength(RobotParameters robot, double length_m) {
  for (auto& s : robot.body.sections) s.unit_length_m *= length_m / robot.body.length_m();
  return robot;
}

/// Tensions at the base that hold a bend of constant curvature at rest (Kane's equations on the arc's motion,
/// least sum of squares over `min_tension_N`).
TendonVector NeededTensions(const Body& body, const BendingVector& us_vs, double min_tension_N) {
  const int k = 2 * body.sections(), n = body.dof();
  Body::Workspace workspace(body);
  VectorXd q(n), force(n), section_force(k);
  const VectorXd still = VectorXd::Zero(n);
  body.SpreadBending(us_vs, q);
  body.InverseDynamics(q, still, still, force, workspace);
  body.ProjectForce(force, section_force);
  MatrixXd per_tension(k, body.tendons());
  model::SectionForcePerTension(body, us_vs, per_tension);
  const auto result =
      model::TensionAllocator(body.tendons(), k).Allocate(per_tension, section_force, min_tension_N, 1e3);
  if (result.status != Status::kOk) throw std::runtime_error("5: no tensions hold the bend wanted");
  return result.tension_N;
}

BendingVector Bend(double theta_rad, double beta_rad) {
  BendingVector b(2);
  b << theta_rad * std::cos(beta_rad), theta_rad * std::sin(beta_rad);
  return b;
}

double PullLoss(const TransmissionParameters& transmission, double base_N) {
  return model::SolveCapstan(transmission.pulleys, base_N) - base_N;
}

// ---- the closed loop ----

struct Run {
  struct Sample {
    double target_s;
    BendingVector bend_rad;  // true
    Vector3d tip_W_m, wanted_W_m;
    TendonVector desired_N, base_N, motor_N;  // desired and base: at the robot, motor: at the spool
  };
  std::vector<Sample> samples;  // every cycle of the motion's judged part
  double min_tension_N = 0;

  template <class Value>
  double Rms(Value value) const {
    double sum = 0;
    for (const Sample& s : samples) sum += value(s) * value(s);
    return std::sqrt(sum / static_cast<double>(samples.size()));
  }
  double TipRms_m() const {
    return Rms([](const Sample& s) { return (s.tip_W_m - s.wanted_W_m).norm(); });
  }
  /// Calls use(sample, tendon) where a tendon is wanted to carry a load, as the demo's figures do.
  template <class Use>
  void ForLoaded(Use use) const {
    for (const Sample& s : samples) {
      for (int j = 0; j < s.desired_N.size(); ++j) {
        if (s.desired_N[j] > min_tension_N + 0.05) use(s, j);
      }
    }
  }
};

Run Follow(Study& study, const RobotParameters& robot, const std::string& motion_name, bool compensation) {
  ClosedLoopOptions options{.controller_robot = robot,
                            .plant_robot = robot,
                            .daemon = config::LoadDaemon(ConfigFile("tendrild.yaml")),
                            .plant = {},
                            .log_path = ""};
  options.daemon.controller.capstan_compensation = compensation;
  const auto motion = MakeMotion(motion_name, robot);
  ClosedLoop loop(options);
  const auto guard = [&](const CycleRecord& r) {
    if (r.output.mode == Mode::kFault) {
      throw std::runtime_error(fmt::format("{} at t = {:.3f} s of the {} motion", StatusText(r.output.status),
                                           loop.now_s(), motion_name));
    }
  };
  loop.ArmAndPretension();
  ApproachStart(loop, *motion, [&](const CycleRecord& r, double) { guard(r); });
  Run run;
  run.min_tension_N = robot.limits.min_tension_N;
  const int tendons = robot.body.tendons();
  StreamMotion(loop, *motion, [&](const CycleRecord& r, double target_s) {
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
      const sim::TendonState& t = loop.plant().tendon()[static_cast<std::size_t>(j)];
      s.base_N[j] = t.tension_base_N;
      s.motor_N[j] = t.tension_motor_N;
    }
    run.samples.push_back(std::move(s));
  });
  return run;
}

void Write(Study& study, const std::string& name, const Run& run, int tendons) {
  Series series =
      study.OpenSeries(name, std::vector<std::string>{"t_s", "us_rad", "vs_rad", "tip_x_m", "tip_y_m",
                                                      "tip_z_m", "wanted_x_m", "wanted_y_m", "wanted_z_m"} +
                                 Numbered("desired_base_N_", tendons) + Numbered("base_N_", tendons) +
                                 Numbered("motor_N_", tendons));
  for (std::size_t i = 0; i < run.samples.size(); i += 10) {
    const Run::Sample& s = run.samples[i];
    series.row().Put(s.target_s).PutAll(s.bend_rad).PutAll(s.tip_W_m).PutAll(s.wanted_W_m);
    series.row().PutAll(s.desired_N).PutAll(s.base_N).PutAll(s.motor_N).EndRow();
  }
}

/// Slope of y over t by least squares.
template <class Time, class Value>
double Slope(const std::vector<Run::Sample>& samples, Time time, Value value) {
  double n = 0, t1 = 0, y1 = 0, tt = 0, ty = 0;
  for (const auto& s : samples) {
    const double t = time(s), y = value(s);
    ++n, t1 += t, y1 += y, tt += t * t, ty += t * y;
  }
  return (n * ty - t1 * y1) / (n * tt - t1 * t1);
}

/// Largest distance of points (x, z) from the best ellipse with its axes along x and z and its centre on z:
/// A x^2 + B z^2 + C z = 1 by least squares, distance to first order.
double OffEllipse(const std::vector<std::array<double, 2>>& points) {
  MatrixXd a(points.size(), 3);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto [x, z] = points[i];
    a.row(static_cast<Eigen::Index>(i)) << x * x, z * z, z;
  }
  const Vector3d c = a.colPivHouseholderQr().solve(VectorXd::Ones(a.rows()));
  double most = 0;
  for (const auto& [x, z] : points) {
    const double value = c[0] * x * x + c[1] * z * z + c[2] * z - 1;
    most = std::max(most, std::abs(value) / std::hypot(2 * c[0] * x, 2 * c[1] * z + c[2]));
  }
  return most;
}

}  // namespace

void PlanarBend(Study& study) {
  study.Begin("5.1: planar bend, needed tensions and losses");
  const RobotParameters rig = Rig("robots/rig_90mm.yaml");
  const Body body(rig.body);
  const TransmissionParameters& transmission = rig.actuation->tendons[0].transmission;
  const PulleyParameters& pulley = transmission.pulleys.front();

  // Statics along the bend with no pretension, as the paper has it.
  Series series =
      study.OpenSeries("planar_statics", {"bend_rad", "tension_1_N", "tension_2_N", "tension_3_N", "loss_N"});
  std::vector<std::array<double, 2>> arc;
  const model::InverseKinematics ik(body, rig.limits.max_bending_rad);
  double least_growth_N = std::numeric_limits<double>::infinity(), others_N = 0, last_loss_N = 0,
         needed_N = 0, loss_N = 0;
  constexpr int kSteps = 80;
  for (int i = 0; i <= kSteps; ++i) {
    const double theta = kPlanarBend_rad * i / kSteps;
    const TendonVector t = NeededTensions(body, Bend(theta, 0), 0);
    needed_N = t[0];
    loss_N = PullLoss(transmission, t[0]);
    others_N = std::max({others_N, t[1], t[2]});
    if (i > 0) least_growth_N = std::min(least_growth_N, loss_N - last_loss_N);
    last_loss_N = loss_N;
    series.row().Put(theta).PutAll(t).Put(loss_N).EndRow();
    const Vector3d tip = ik.Tip(Bend(theta, 0));
    arc.push_back({tip.x(), tip.z()});
  }

  study.Begin("5.1: planar bend in the closed loop, compensation on");
  const Run run = Follow(study, rig, "planar", true);
  Write(study, "planar_loop", run, 3);
  study.Begin("5.1: planar bend in the closed loop, compensation off");
  const Run without = Follow(study, rig, "planar", false);
  double largest_N = 0, bend_at_largest_rad = 0, others_mean_N = 0, first_mean_N = 0;
  std::vector<std::array<double, 2>> true_path;
  std::vector<Run::Sample> ramp;
  for (const Run::Sample& s : run.samples) {
    const double loss = s.motor_N[0] - s.base_N[0];
    if (loss > largest_N) {
      largest_N = loss;
      bend_at_largest_rad = s.bend_rad[0];
    }
    first_mean_N += s.base_N[0] / static_cast<double>(run.samples.size());
    others_mean_N += 0.5 * (s.base_N[1] + s.base_N[2]) / static_cast<double>(run.samples.size());
    true_path.push_back({s.tip_W_m.x(), s.tip_W_m.z()});
    if (s.target_s > 1 && s.target_s < kPlanarBend_rad / kPlanarRate_radps - 0.2) ramp.push_back(s);
  }
  const auto time_of = [](const Run::Sample& s) { return s.target_s; };
  const double rate_radps = Slope(ramp, time_of, [](const Run::Sample& s) { return s.bend_rad[0]; });

  study.Add({.id = "5.1_rate",
             .section = "5.1",
             .figure = "Fig. 11",
             .what = "the bend grows at 0.26 rad/s",
             .says = "The robot bends in the plane at a constant rate of 0.26 rad/s.",
             .paper = "0.26 rad/s",
             .ours = fmt::format("{:.4f} rad/s", rate_radps),
             .paper_value = kPlanarRate_radps,
             .our_value = rate_radps,
             .unit = "rad/s",
             .verdict = Apart(rate_radps, kPlanarRate_radps) < 0.02 ? Verdict::kConfirmed : Verdict::kDiffers,
             .reason = "True bend of the simulated rig while following that command (line through its ramp): "
                       "the loop realises "
                       "the commanded rate. The rate itself is a choice of the experiment.",
             .readings = ordered_json::object(),
             .plot = "fig11"});

  const double off_m = OffEllipse(arc), true_off_m = OffEllipse(true_path), length_m = rig.body.length_m();
  study.Add(
      {.id = "5.1_path",
       .section = "5.1",
       .figure = "Fig. 11a",
       .what = "the tip moves on an elliptic arc",
       .says = "The tip's path in the plane is an arc of an ellipse.",
       .paper = "ellipse",
       .ours = fmt::format("within {:.3f} mm of one", 1e3 * off_m),
       .paper_value = 0,
       .our_value = 1e3 * off_m,
       .unit = "mm",
       .verdict = off_m < 0.005 * length_m ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "The exact path is (L (1 - cos theta) / theta, L sin theta / theta), no ellipse, but up to {:.1f} "
           "rad it stays within "
           "{:.3f} mm ({:.3f} % of the length) of the best one; the simulated rig's tip within {:.3f} mm.",
           kPlanarBend_rad, 1e3 * off_m, 100 * off_m / length_m, 1e3 * true_off_m),
       .readings = ordered_json::object(),
       .plot = "fig11"});

  study.Add(
      {.id = "5.1_tendon1_only",
       .section = "5.1",
       .figure = "Fig. 11c",
       .what = "only tendon 1 carries load",
       .says = "Only tendon 1 pulls; the other tendons' tensions are 0.",
       .paper = "0 N in the others",
       .ours = fmt::format("{:.2g} N in the others", others_N),
       .paper_value = 0,
       .our_value = others_N,
       .unit = "N",
       .verdict = others_N < 1e-6 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "With no least tension the allocation uses tendon 1 alone ({:.2f} N at {:.1f} rad). A real rig "
           "cannot let a tendon go slack: ours keeps {:.1f} N at the base, {:.2f} N on average in the run.",
           needed_N, kPlanarBend_rad, rig.limits.min_tension_N, others_mean_N),
       .readings = {{"model, no pretension",
                     {{"tendon 1 at 1.6 rad [N]", needed_N}, {"others, largest [N]", others_N}}},
                    {"simulated rig",
                     {{"tendon 1, mean [N]", first_mean_N}, {"others, mean [N]", others_mean_N}}}},
       .plot = "fig11"});

  // What the paper leaves open: the friction's constants, the mounting, the length, the wire.
  ordered_json readings;
  double least_fig7_N = std::numeric_limits<double>::infinity(), most_fig7_N = 0;
  const auto put = [&](const std::string& name, double tension_N, double loss) {
    readings[name] = {{"tension needed [N]", tension_N},
                      {"loss [N]", loss},
                      {"loss / needed", loss / tension_N},
                      {"1.26 N / needed", kPlanarLoss_N / tension_N},
                      {"classic alpha wrap that loses 1.26 N", std::log1p(kPlanarLoss_N / tension_N)}};
  };
  put(fmt::format("rig: alpha {}, n {}, rho {}, wrap {:.2f}", pulley.alpha, pulley.exponent,
                  pulley.radius_ratio, pulley.wrap_rad),
      needed_N, loss_N);
  put("the same with the rig's pretension",
      NeededTensions(body, Bend(kPlanarBend_rad, 0), rig.limits.min_tension_N)[0],
      PullLoss(transmission, NeededTensions(body, Bend(kPlanarBend_rad, 0), rig.limits.min_tension_N)[0]));
  for (const double alpha : {0.15, 0.6}) {
    for (const double n : {0.67, 1.0}) {
      PulleyParameters p = pulley;
      p.alpha = alpha;
      p.exponent = n;
      p.wrap_rad = kPi;
      p.radius_ratio = 10;
      const double loss = model::SolveCapstan(p, needed_N) - needed_N;
      least_fig7_N = std::min(least_fig7_N, loss);
      most_fig7_N = std::max(most_fig7_N, loss);
      put(fmt::format("Fig. 7's alpha {}, n {}, rho 10, wrap pi", alpha, n), needed_N, loss);
    }
  }
  const auto variant = [&](const std::string& name, BodyParameters p) {
    const double t = NeededTensions(Body(p), Bend(kPlanarBend_rad, 0), 0)[0];
    put(name, t, PullLoss(transmission, t));
  };
  {
    BodyParameters p = rig.body;
    p.gravity_W_mps2 = -p.gravity_W_mps2;
    variant("hanging", p);
    p.gravity_W_mps2 = {-rig.body.gravity_W_mps2.norm(), 0, 0};
    variant("horizontal, bends upwards", p);
    p = WithLength(rig, 0.060).body;
    variant("60 mm long", p);
    p = rig.body;
    for (auto& s : p.sections) s.core_radius_m = kWireRadius_m;
    variant("wire of 0.8 mm as in section 5", p);
  }
  study.Add(
      {.id = "5.1_loss",
       .section = "5.1",
       .figure = "Fig. 11d",
       .what = "at 1.6 rad the loss is 1.26 N",
       .says = "The deviation between theoretical and measured tension is largest at 1.6 rad: 1.26 N.",
       .paper = "1.26 N",
       .ours = fmt::format("{:.2f} N", loss_N),
       .paper_value = kPlanarLoss_N,
       .our_value = loss_N,
       .unit = "N",
       .verdict = Apart(loss_N, kPlanarLoss_N) < 0.05 ? Verdict::kNotAsStated : Verdict::kDiffers,
       .reason = fmt::format(
           "The rig's alpha, n, rho and wrap are not printed. Tendon 1 needs {:.2f} N, and Fig. 7's "
           "parameters (rho 10, wrap "
           "pi) lose {:.2f} to {:.2f} N there, which encloses 1.26 N. Our rig's alpha = {} was chosen to "
           "meet the value, so "
           "{:.2f} N by the law and {:.2f} N at most in the closed loop show consistency, no prediction.",
           needed_N, least_fig7_N, most_fig7_N, pulley.alpha, loss_N, largest_N),
       .readings = readings,
       .plot = "fig11"});
  study.Add({.id = "5.1_grows",
             .section = "5.1",
             .figure = "Fig. 11d",
             .what = "the loss grows with the bend",
             .says = "The tension loss grows with the bending angle and is largest at 1.6 rad.",
             .paper = "largest at 1.6 rad",
             .ours = fmt::format("largest at {:.2f} rad", bend_at_largest_rad),
             .paper_value = kPlanarBend_rad,
             .our_value = bend_at_largest_rad,
             .unit = "rad",
             .verdict = least_growth_N > 0 && Apart(bend_at_largest_rad, kPlanarBend_rad) < 0.1
                            ? Verdict::kConfirmed
                            : Verdict::kDiffers,
             .reason = fmt::format("The needed tension grows with the bend and the loss with the tension, at "
                                   "each of {} steps; in the "
                                   "closed loop the loss is largest, {:.2f} N, at a true bend of {:.2f} rad.",
                                   kSteps, largest_N, bend_at_largest_rad),
             .readings = ordered_json::object(),
             .plot = "fig11"});
  const double share = kPlanarLoss_N / needed_N;
  study.Add(
      {.id = "5.1_negligible",
       .section = "5.1",
       .figure = "Fig. 11d",
       .what = "1.26 N is small and may be neglected",
       .says = "The deviation is a small share and can be neglected.",
       .paper = "negligible",
       .ours = fmt::format("{:.0f} % of the tension", 100 * share),
       .paper_value = std::nullopt,
       .our_value = share,
       .unit = "of the needed tension",
       .verdict = share < kNegligible ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "1.26 N is {:.0f} % of the {:.2f} N that the bend needs. In the closed loop, leaving the pulleys' "
           "friction out of the feed-forward raises the tip's rms error from {:.1f} to {:.1f} mm.",
           100 * share, needed_N, 1e3 * run.TipRms_m(), 1e3 * without.TipRms_m()),
       .readings = {{"compensation on", {{"tip error, rms [mm]", 1e3 * run.TipRms_m()}}},
                    {"compensation off", {{"tip error, rms [mm]", 1e3 * without.TipRms_m()}}}},
       .plot = "fig11"});
}

namespace {

struct CircleLosses {
  double mean_needed_N = 0;         // over the revolution, per tendon
  double classic_pull_N = 0;        // every tendon as if pulled, classic law with one alpha wrap
  double improved_pull_N = 0;       // the same with the rig's law
  double alpha_wrap_for_paper = 0;  // classic constant that gives 0.42 N
};

CircleLosses LossesOnCircle(const RobotParameters& robot, double alpha_wrap) {
  const Body body(robot.body);
  const TransmissionParameters& transmission = robot.actuation->tendons[0].transmission;
  constexpr int kSteps = 120;
  CircleLosses out;
  for (int i = 0; i < kSteps; ++i) {
    const TendonVector t = NeededTensions(body, Bend(kCircleBend_rad, 2 * kPi * i / kSteps), 0);
    for (const double tension_N : t) {
      const double weight = 1.0 / (kSteps * static_cast<double>(t.size()));
      out.mean_needed_N += weight * tension_N;
      out.improved_pull_N += weight * PullLoss(transmission, tension_N);
    }
  }
  out.classic_pull_N = out.mean_needed_N * std::expm1(alpha_wrap);
  out.alpha_wrap_for_paper = std::log1p(kCircleLoss_N / out.mean_needed_N);
  return out;
}

ordered_json Row(const CircleLosses& c, double alpha_wrap) {
  return {{"mean needed tension [N]", c.mean_needed_N},
          {fmt::format("all pulled, classic, alpha wrap {:.3f} [N]", alpha_wrap), c.classic_pull_N},
          {"all pulled, rig's law [N]", c.improved_pull_N},
          {"classic alpha wrap that loses 0.42 N", c.alpha_wrap_for_paper}};
}

struct LoopLosses {
  double signed_mean_N = 0, size_mean_N = 0, pulling_mean_N = 0, above = 0;  // above: share of samples
};

LoopLosses LossesOf(const Run& run) {
  LoopLosses out;
  double n = 0, above = 0, pulled_N = 0;
  run.ForLoaded([&](const Run::Sample& s, int j) {
    const double loss = s.motor_N[j] - s.base_N[j];
    ++n;
    out.signed_mean_N += loss;
    out.size_mean_N += std::abs(loss);
    if (loss > 0) {
      ++above;
      pulled_N += loss;
    }
  });
  out.signed_mean_N /= n;
  out.size_mean_N /= n;
  out.pulling_mean_N = pulled_N / std::max(1.0, above);
  out.above = above / n;
  return out;
}

}  // namespace

void SpatialCircle(Study& study) {
  study.Begin("5.2: circle, needed tensions and losses");
  const RobotParameters three = Rig("robots/rig_60mm.yaml");
  const RobotParameters four = WithLength(Rig("robots/four_tendon_90mm.yaml"), three.body.length_m());
  // One classic constant alpha wrap, from 5.1's number on the 90 mm robot.
  const Body planar_body(Rig("robots/rig_90mm.yaml").body);
  const double planar_N = NeededTensions(planar_body, Bend(kPlanarBend_rad, 0), 0)[0];
  const double alpha_wrap = std::log1p(kPlanarLoss_N / planar_N);
  const CircleLosses losses3 = LossesOnCircle(three, alpha_wrap), losses4 = LossesOnCircle(four, alpha_wrap);

  study.Begin("5.2: circle in the closed loop, 3 tendons");
  const Run run3 = Follow(study, three, "circle", true);
  Write(study, "circle_loop_3", run3, 3);
  study.Begin("5.2: circle in the closed loop, 4 tendons");
  const Run run4 = Follow(study, four, "circle", true);
  Write(study, "circle_loop_4", run4, 4);
  const LoopLosses loop3 = LossesOf(run3), loop4 = LossesOf(run4);

  double least_rad = std::numeric_limits<double>::infinity(), most_rad = 0, mean_rad = 0;
  for (const Run::Sample& s : run3.samples) {
    const double theta = s.bend_rad.norm();
    least_rad = std::min(least_rad, theta);
    most_rad = std::max(most_rad, theta);
    mean_rad += theta / static_cast<double>(run3.samples.size());
  }
  study.Add(
      {.id = "5.2_bend",
       .section = "5.2",
       .figure = "Fig. 13b",
       .what = "the rig's bend stays at pi/3",
       .says = "The robot moves on the circle with a constant bending angle of pi/3.",
       .paper = "pi/3 = 1.0472 rad",
       .ours =
           fmt::format("{:.4f} rad, {:+.3f} {:+.3f}", mean_rad, most_rad - mean_rad, least_rad - mean_rad),
       .paper_value = kCircleBend_rad,
       .our_value = mean_rad,
       .unit = "rad",
       .verdict = Apart(mean_rad, kCircleBend_rad) < 0.02 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "True bend of the simulated 60 mm rig over a revolution, its tip within {:.2f} mm rms of eq. 31: "
           "feed-forward alone, without feedback of the shape, leaves that much.",
           1e3 * run3.TipRms_m()),
       .readings = ordered_json::object(),
       .plot = "fig13"});

  ordered_json readings;
  for (const auto& [name, c, l] : {std::tuple{"3 tendons, 60 mm robot", losses3, loop3},
                                   std::tuple{"4 tendons, 60 mm robot", losses4, loop4}}) {
    readings[name] = Row(c, alpha_wrap);
    readings[name]["closed loop, signed mean [N]"] = l.signed_mean_N;
    readings[name]["closed loop, mean size [N]"] = l.size_mean_N;
    readings[name]["closed loop, mean while above the base's [N]"] = l.pulling_mean_N;
  }
  for (const auto& [name, robot] :
       {std::pair{"3 tendons, 90 mm robot", Rig("robots/rig_90mm.yaml")},
        std::pair{"4 tendons, 90 mm robot", Rig("robots/four_tendon_90mm.yaml")}}) {
    readings[name] = Row(LossesOnCircle(robot, alpha_wrap), alpha_wrap);
  }
  study.Add(
      {.id = "5.2_loss",
       .section = "5.2",
       .figure = "Fig. 13e",
       .what = "mean loss on the circle is 0.42 N",
       .says = "On the circle the tendons lose 0.42 N each on average.",
       .paper = "0.42 N",
       .ours = fmt::format("3 tendons {:.2f}, 4: {:.2f} N", losses3.classic_pull_N, losses4.classic_pull_N),
       .paper_value = kCircleLoss_N,
       .our_value = losses3.classic_pull_N,
       .unit = "N",
       .verdict =
           Apart(losses3.classic_pull_N, kCircleLoss_N) < 0.1 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "5.1 fixes a classic constant alpha wrap of {:.2f}. With 3 tendons as modelled it loses {:.2f} N "
           "on the circle of the "
           "60 mm robot, counting every tendon as pulled; with the 4 ropes of section 5 (which has 3 motors) "
           "{:.2f} "
           "N: there one "
           "constant of {:.2f} to {:.2f} explains both experiments, with 3 tendons 0.42 N would need {:.2f}. "
           "Counting the "
           "sign (pull less release), the simulated rig loses only {:.2f} N (3) and {:.2f} N (4) on average.",
           alpha_wrap, losses3.classic_pull_N, losses4.classic_pull_N,
           std::min(alpha_wrap, losses4.alpha_wrap_for_paper),
           std::max(alpha_wrap, losses4.alpha_wrap_for_paper), losses3.alpha_wrap_for_paper,
           loop3.signed_mean_N, loop4.signed_mean_N),
       .readings = readings,
       .plot = "fig13"});
  study.Add(
      {.id = "5.2_theory_below_actual",
       .section = "5.2",
       .figure = "Fig. 13d",
       .what = "theory slightly below actual tension",
       .says = "The theoretical tension is slightly smaller than the one applied (also conclusion 1).",
       .paper = "slightly below",
       .ours = fmt::format("{:.0f} % of the time", 100 * loop3.above),
       .paper_value = 1,
       .our_value = loop3.above,
       .unit = "share of the loaded time",
       .verdict = loop3.above > 0.95 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "True while a tendon is pulled, and on average ({:+.2f} N). While it is paid out, friction holds "
           "part of the robot's tension and the motor needs less. The actual tension would always be the "
           "larger one "
           "only if friction were added whatever the direction, as the feed-forward of Fig. 8 seems to do.",
           loop3.signed_mean_N),
       .readings = {{"3 tendons", {{"time above [%]", 100 * loop3.above}, {"mean [N]", loop3.signed_mean_N}}},
                    {"4 tendons",
                     {{"time above [%]", 100 * loop4.above}, {"mean [N]", loop4.signed_mean_N}}}},
       .plot = "fig13"});
  study.Begin("5.2: circle in the closed loop, compensation off");
  const Run without = Follow(study, three, "circle", false);
  const double share = kCircleLoss_N / losses3.mean_needed_N, share4 = kCircleLoss_N / losses4.mean_needed_N;
  study.Add(
      {.id = "5.2_negligible",
       .section = "5.2",
       .figure = "Fig. 13e",
       .what = "0.42 N is small and may be neglected",
       .says = "The mean error of 0.42 N is small and can be neglected.",
       .paper = "negligible",
       .ours = fmt::format("{:.0f} % of mean tension", 100 * share),
       .paper_value = std::nullopt,
       .our_value = share,
       .unit = "of the mean needed tension",
       .verdict = share < kNegligible ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format("Mean needed tension {:.2f} N with 3 tendons, {:.2f} N with 4 ({:.0f} %). "
                             "Leaving friction out of the "
                             "feed-forward raises the simulated tip's rms error from {:.2f} to {:.2f} mm.",
                             losses3.mean_needed_N, losses4.mean_needed_N, 100 * share4,
                             1e3 * run3.TipRms_m(), 1e3 * without.TipRms_m()),
       .readings = {{"compensation on", {{"tip error, rms [mm]", 1e3 * run3.TipRms_m()}}},
                    {"compensation off", {{"tip error, rms [mm]", 1e3 * without.TipRms_m()}}}},
       .plot = "fig13"});
}

void ConstantCurvature(Study& study) {
  study.Begin("6: constant curvature against the true equilibrium");
  ordered_json readings;
  double worst = 0, worst_mm = 0, worst_spread = 0;
  for (const auto& [name, file, bend] :
       {std::tuple{"planar bend of 1.6 rad, 90 mm", "robots/qi2021_90mm.yaml", kPlanarBend_rad},
        std::tuple{"circle at pi/3, 60 mm", "robots/qi2021_60mm.yaml", kCircleBend_rad}}) {
    const Body body(Rig(file).body);
    const model::InverseKinematics ik(body, 2.6);
    double off_m = 0, spread = 0, sum_rad = 0;
    // Every direction of the bend; the planar motion's is 0.
    const int directions = bend == kPlanarBend_rad ? 1 : 36;
    for (int i = 0; i < directions; ++i) {
      const BendingVector wanted = Bend(bend, 2 * kPi * i / directions);
      const auto e = model::SolveStatics(body, NeededTensions(body, wanted, 0), Vector3d::Zero());
      if (e.result != model::StaticsResult::kConverged)
        throw std::runtime_error(fmt::format("6: no equilibrium for {}", name));
      off_m = std::max(off_m, (body.TipPose(e.q).p_WA - ik.Tip(wanted)).norm());
      double least = std::numeric_limits<double>::infinity(), most = 0;
      for (int u = 0; u < body.units(); ++u) {
        least = std::min(least, e.q.segment<2>(2 * u).norm());
        most = std::max(most, e.q.segment<2>(2 * u).norm());
      }
      spread = std::max(spread, (most - least) * body.units() / bend);
      BendingVector sum(2);
      body.SumBending(e.q, sum);
      sum_rad = std::max(sum_rad, std::abs(sum.norm() - bend));
    }
    const double share = off_m / body.parameters().length_m();
    readings[name] = {{"tip off the arc's [mm]", 1e3 * off_m},
                      {"tip off [% of length]", 100 * share},
                      {"units differ by [% of their mean]", 100 * spread},
                      {"whole bend off [rad]", sum_rad}};
    if (share > worst) {
      worst = share;
      worst_mm = 1e3 * off_m;
    }
    worst_spread = std::max(worst_spread, spread);
  }
  study.Add(
      {.id = "6_constant_curvature",
       .section = "6",
       .figure = "",
       .what = "the arc assumption is good enough",
       .says = "The experiments confirm the constant-curvature assumption (conclusion 2).",
       .paper = "confirmed",
       .ours = fmt::format("tip off by {:.1f} mm", worst_mm),
       .paper_value = std::nullopt,
       .our_value = worst_mm,
       .unit = "mm",
       .verdict = worst < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "Tensions computed for a perfect arc leave the paper's own four-unit robot, friction aside, "
           "{:.1f} mm "
           "({:.1f} % of its length) from the wanted tip, with units up to {:.0f} % apart: gravity does not "
           "bend them equally.",
           worst_mm, 100 * worst, 100 * worst_spread),
       .readings = readings,
       .plot = ""});
}

}  // namespace tendril::tools::reproduce
