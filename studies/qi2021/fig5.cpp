// 3.2, Fig. 5: 5 N on tendon 1.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "body_motion.h"
#include "figures.h"
#include "paper.h"
#include "tendril/model/statics.h"

namespace tendril::qi2021 {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;
using nlohmann::ordered_json;

constexpr double kSettled_rad = 1e-3;
constexpr double kWindow_s = 2;

struct PulledMotion {
  double settled_s = 0;                      // last time a unit was farther than kSettled_rad from rest
  double energy_left = 0;                    // energy of the motion at the end over that at the start
  VectorXd first_swing_rad, last_swing_rad;  // half the range of each unit's u in the first and last window
  VectorXd peak_rad;                         // of each unit's u
  double largest_v_rad = 0;
  VectorXd end_q;
};

PulledMotion RunPulled(Study& study, const Body& body, const VectorXd& rest_q, double until_s,
                       double tolerance, const std::string& series_name) {
  const int n = body.units();
  VectorXd tension = VectorXd::Zero(body.tendons());
  tension[0] = kPull_N;
  Body::Workspace workspace(body);
  const VectorXd still = VectorXd::Zero(body.dof()), start = Bent(body, kPullStart_rad, kPullStartBeta_rad);
  const double rest_J = TotalEnergy(body, tension, rest_q, still, workspace);
  const double start_J = TotalEnergy(body, tension, start, still, workspace);
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  VectorXd least[2] = {VectorXd::Constant(n, kInfinity), VectorXd::Constant(n, kInfinity)};
  VectorXd most[2] = {-least[0], -least[1]};
  PulledMotion out;
  out.peak_rad = VectorXd::Constant(n, -kInfinity);
  std::optional<Series> series;
  if (!series_name.empty()) series.emplace(study.OpenSeries(series_name, UnitColumns(body)));
  std::int64_t samples = 0;
  model::Simulate(body, Constant(tension, until_s), start, still, 1e-3, tolerance,
                  [&](double t_s, model::ConstVectorRef q, model::ConstVectorRef dq) {
                    ++samples;
                    const VectorXd u = q(Eigen::seqN(0, n, Eigen::fix<2>));
                    const VectorXd v = q(Eigen::seqN(1, n, Eigen::fix<2>));
                    out.peak_rad = out.peak_rad.cwiseMax(u);
                    out.largest_v_rad = std::max(out.largest_v_rad, v.lpNorm<Eigen::Infinity>());
                    for (const int window : {0, 1}) {
                      if (window == 0 ? t_s <= kWindow_s : t_s >= until_s - kWindow_s) {
                        least[window] = least[window].cwiseMin(u);
                        most[window] = most[window].cwiseMax(u);
                      }
                    }
                    if ((q - rest_q).lpNorm<Eigen::Infinity>() > kSettled_rad) out.settled_s = t_s;
                    out.energy_left =
                        (TotalEnergy(body, tension, q, dq, workspace) - rest_J) / (start_J - rest_J);
                    out.end_q = q;
                    if (series && t_s < 5 + 1e-9 && samples % 2 == 1) PutState(*series, t_s, q);
                    if (samples % 256 == 0) study.Progress(t_s / until_s);
                  });
  out.first_swing_rad = 0.5 * (most[0] - least[0]);
  out.last_swing_rad = 0.5 * (most[1] - least[1]);
  return out;
}

bool Falls(const VectorXd& x) {
  for (Eigen::Index i = 1; i < x.size(); ++i) {
    if (x[i] >= x[i - 1]) return false;
  }
  return true;
}

std::string Listed(const VectorXd& x, int digits) {
  std::string text;
  for (const double value : x) text += fmt::format("{}{:.{}f}", text.empty() ? "" : ", ", value, digits);
  return text;
}

BodyParameters Damped(BodyParameters p, double damping_Nms) {
  for (auto& s : p.sections) s.bending_damping_Nms = damping_Nms;
  return p;
}

VectorXd Pull(const Body& body) {
  VectorXd tension = VectorXd::Zero(body.tendons());
  tension[0] = kPull_N;
  return tension;
}

/// Bend of each unit at the end of the motion.
VectorXd EndAngles(const PulledMotion& m) {
  VectorXd theta(m.end_q.size() / 2);
  for (Eigen::Index i = 0; i < theta.size(); ++i) theta[i] = m.end_q.segment<2>(2 * i).norm();
  return theta;
}

ordered_json Row(const PulledMotion& m, bool damped) {
  const Eigen::Index n = m.peak_rad.size();
  return {{"within 1e-3 rad after [s]", damped ? ordered_json(m.settled_s) : ordered_json("never")},
          {"swing of unit 1, first 2 s [rad]", m.first_swing_rad[0]},
          {"swing of unit 1, last 2 s [rad]", m.last_swing_rad[0]},
          {"swing of unit 4, first 2 s [rad]", m.first_swing_rad[n - 1]},
          {"swing of unit 4, last 2 s [rad]", m.last_swing_rad[n - 1]},
          {"energy of the motion left [%]", 100 * m.energy_left}};
}

/// Undamped and with more and more damping; returns the motion with the damping stated.
PulledMotion Convergence(Study& study, const BodyParameters& parameters, const VectorXd& rest_q,
                         const PulledMotion& undamped, double damping_Nms) {
  study.Begin("3.2: the same with damping");
  ordered_json dampings;
  PulledMotion damped;
  for (const double factor : {0.0, 0.5, 1.0, 2.0}) {
    const Body b(Damped(parameters, factor * damping_Nms));
    const PulledMotion m =
        factor == 0 ? undamped : RunPulled(study, b, rest_q, 20, 1e-9, factor == 1 ? "pull_damped" : "");
    if (factor == 1) damped = m;
    dampings[fmt::format("damping {:.1e} N m s/rad", factor * damping_Nms)] = Row(m, factor != 0);
  }
  const double remaining = undamped.last_swing_rad[0] / undamped.first_swing_rad[0];
  study.Find("3.2_convergence",
             {.ours = fmt::format("{:.0f} % swing left at {:.0f} s", 100 * remaining, kLongRun_s),
              .our_value = undamped.last_swing_rad[0],
              .verdict = remaining > 0.5 ? Verdict::kNotAsStated : Verdict::kConfirmed,
              .reason = fmt::format(
                  "Eqs. 13 to 25 contain nothing that dissipates: after {:.0f} s unit 1 still swings by "
                  "±{:.3f} rad (±{:.3f} at first) and {:.4f} % of the motion's energy is left. The paper "
                  "blames the transmission's friction, which its simulation does not contain; its figure "
                  "must have damping that is not stated, or the solver's. With {:.0e} N m s/rad a unit, our "
                  "addition, all units are within 1e-3 rad of rest after {:.1f} s.",
                  kLongRun_s, undamped.last_swing_rad[0], undamped.first_swing_rad[0],
                  100 * undamped.energy_left, damping_Nms, damped.settled_s),
              .readings = dampings});
  return damped;
}

/// Where a robot comes to rest, as a reading of what the paper leaves open.
ordered_json RestOf(Study& study, const BodyParameters& damped) {
  const Body b(damped);
  const int n = b.units();
  const auto e = model::SolveStatics(b, Pull(b), Vector3d::Zero());
  ordered_json row;
  if (e.result != model::StaticsResult::kConverged) {
    for (int i = 1; i <= n; ++i) row[fmt::format("unit {} [rad]", i)] = "none";
    return row;
  }
  const PulledMotion m = RunPulled(study, b, e.q, 20, 1e-9, "");
  const VectorXd theta = EndAngles(m);
  for (int i = 0; i < n; ++i) row[fmt::format("unit {} [rad]", i + 1)] = theta[i];
  row["mean / (pi/6)"] = theta.mean() / kPaperEquilibrium_rad;
  row["whole robot [rad]"] = m.end_q(Eigen::seqN(0, n, Eigen::fix<2>)).sum();
  row["falls from base to tip"] = Falls(theta) ? "yes" : "no";
  row["end of motion less equilibrium [rad]"] = (m.end_q - e.q).lpNorm<Eigen::Infinity>();
  return row;
}

/// Every mounting and length, and the wire of section 5.
ordered_json PrintedReadings(Study& study, double damping_Nms) {
  ordered_json readings;
  for (const auto& [length_name, file] :
       {std::pair{"90 mm", "robots/qi2021_90mm.yaml"}, std::pair{"60 mm", "robots/qi2021_60mm.yaml"}}) {
    const BodyParameters base = study.Robot(file).body;
    for (const Placement& placement : kPlacements) {
      readings[fmt::format("{}, {}", placement.name, length_name)] =
          RestOf(study, Damped(Placed(base, placement), damping_Nms));
    }
  }
  BodyParameters thin = study.Robot("robots/qi2021_90mm.yaml").body;
  for (auto& s : thin.sections) s.core_radius_m = kWireRadius_m;
  readings["upright, 90 mm, wire of 0.8 mm as in section 5"] = RestOf(study, Damped(thin, damping_Nms));
  return readings;
}

struct Spread {
  double least_elsewhere = 1e9, most_elsewhere = 0;  // mean / (pi/6) of all readings but the stated one
  int fall = 0, rise = 0;
  std::string risers;
};

Spread SpreadOf(const ordered_json& readings) {
  Spread out;
  for (const auto& [name, row] : readings.items()) {
    if (!row.contains("mean / (pi/6)")) continue;
    const double ratio = row["mean / (pi/6)"];
    if (name != "upright, 90 mm") {
      out.least_elsewhere = std::min(out.least_elsewhere, ratio);
      out.most_elsewhere = std::max(out.most_elsewhere, ratio);
    }
    const bool falls = row["falls from base to tip"] == "yes";
    ++(falls ? out.fall : out.rise);
    if (!falls) out.risers += (out.risers.empty() ? "" : "; ") + name;
  }
  return out;
}

void Equilibrium(Study& study, const ordered_json& readings, const Spread& spread, const VectorXd& theta) {
  const auto& [least_elsewhere, most_elsewhere, fall, rise, risers] = spread;
  const double mean_rad = theta.mean(), apart = Apart(mean_rad, kPaperEquilibrium_rad);
  study.Find("3.2_equilibrium",
             {.ours = fmt::format("{:.4f} rad, mean", mean_rad),
              .our_value = mean_rad,
              .verdict = apart < 0.05 ? Verdict::kConfirmed : Verdict::kDiffers,
              .reason = fmt::format(
                  "With the damping stated, upright and 90 mm long, the units come to rest at {} rad, {:.1f} "
                  "% from pi/6 on average; pi/6 is the angle of a unit (the whole robot bends by {:.2f} "
                  "rad). Every other reading is farther away: {:.2f} to {:.2f} times pi/6.",
                  Listed(theta, 4), 100 * (mean_rad / kPaperEquilibrium_rad - 1), theta.sum(),
                  least_elsewhere, most_elsewhere),
              .readings = readings});
}

void Order(Study& study, const Spread& spread, const PulledMotion& undamped, const PulledMotion& damped,
           const VectorXd& theta) {
  const auto& [least_elsewhere, most_elsewhere, fall, rise, risers] = spread;
  const Eigen::Index n = theta.size();
  ordered_json orders;
  for (const auto& [name, m] :
       {std::pair{"undamped, peak", undamped.peak_rad},
        std::pair{"undamped, swing in the first 2 s", undamped.first_swing_rad},
        std::pair{"damped, peak", damped.peak_rad}, std::pair{"damped, at rest", theta}}) {
    for (int i = 0; i < n; ++i) orders[name][fmt::format("unit {} [rad]", i + 1)] = m[i];
    orders[name]["falls from base to tip"] = Falls(m) ? "yes" : "no";
  }
  study.Find(
      "3.2_order",
      {.ours = Falls(theta) ? "fall" : "do not fall",
       .our_value = theta[n - 1] / theta[0],
       .verdict = Falls(theta) && Falls(damped.peak_rad) ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format("At rest {} rad (last / first {:.3f}), at the first peak {} rad: gravity adds "
                             "most at the base of an upright robot. It holds for {} of {} readings{}{}.",
                             Listed(theta, 3), theta[n - 1] / theta[0], Listed(damped.peak_rad, 3), fall,
                             fall + rise, risers.empty() ? "" : ", not for: ", risers),
       .readings = orders});
}

}  // namespace

void SingleTendon(Study& study) {
  const BodyParameters parameters = study.Robot("robots/qi2021_90mm.yaml").body;
  const Body body(parameters);
  // The paper has no damping; the nominal rig's is the one we add and state.
  const double damping_Nms = study.Robot("robots/rig_90mm.yaml").body.sections[0].bending_damping_Nms;

  study.Begin("3.2: 5 N on tendon 1, undamped");
  const auto rest = model::SolveStatics(body, Pull(body), Vector3d::Zero());
  if (rest.result != model::StaticsResult::kConverged)
    throw std::runtime_error("3.2: the upright 90 mm robot has no equilibrium under 5 N");
  const PulledMotion undamped = RunPulled(study, body, rest.q, kLongRun_s, 1e-10, "pull_undamped");
  const PulledMotion damped = Convergence(study, parameters, rest.q, undamped, damping_Nms);

  study.Begin("3.2: orientations and lengths");
  const ordered_json readings = PrintedReadings(study, damping_Nms);
  const Spread spread = SpreadOf(readings);
  const VectorXd theta = EndAngles(damped);
  Equilibrium(study, readings, spread, theta);
  Order(study, spread, undamped, damped, theta);
  study.Find("3.2_beta",
             {.ours = fmt::format("|v| <= {:.1e} rad", undamped.largest_v_rad),
              .our_value = undamped.largest_v_rad,
              .verdict = undamped.largest_v_rad < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
              .reason = fmt::format(
                  "The start leans out of the plane by {:.1e} rad a unit; undamped it sways between such "
                  "values and grows to {:.1e} rad at most in {:.0f} s; damped it dies out.",
                  kPullStart_rad * kPullStartBeta_rad, undamped.largest_v_rad, kLongRun_s)});
}

}  // namespace tendril::qi2021
