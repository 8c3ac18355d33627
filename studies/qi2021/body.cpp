// The paper's claims about the body alone, without motors and pulleys: eq. 31, 3.1 (Fig. 4) and 3.2 (Fig. 5).
// Knows robots from their files; computes with the model room only.
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "paths.h"
#include "study.h"
#include "tendril/config/config.h"
#include "tendril/model/inverse.h"
#include "tendril/model/simulate.h"
#include "tendril/model/statics.h"

namespace tendril::tools::reproduce {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;
using nlohmann::ordered_json;
constexpr double kPi = std::numbers::pi;

BodyParameters PaperBody(const char* file) { return config::LoadRobot(ConfigFile(file)).body; }
BodyParameters Body90() { return PaperBody("robots/qi2021_90mm.yaml"); }
BodyParameters Body60() { return PaperBody("robots/qi2021_60mm.yaml"); }

// ---- eq. 31 ----

constexpr double kCircleRadius_m = 28.6479e-3, kCircleHeight_m = 49.6196e-3;                // eq. 31
constexpr double kCircleRate_radps = kPi / 6;                                               // eq. 31
constexpr double kCircleBend_rad = kPi / 3, kTextRate_radps = 0.53, kTextLength_m = 0.090;  // 5, 5.2

Vector3d CircleTip(double t_s) {
  return {kCircleRadius_m * std::cos(kCircleRate_radps * t_s),
          kCircleRadius_m * std::sin(kCircleRate_radps * t_s), kCircleHeight_m};
}

}  // namespace

void CircleGeometry(Study& study) {
  study.Begin("eq. 31: the circle's geometry");
  // Eq. 5 with atan2: the bend of an arc from its chord does not depend on its length.
  const double bend_rad = 2 * std::atan2(kCircleRadius_m, kCircleHeight_m);
  const double length_m = kCircleRadius_m * bend_rad / (1 - std::cos(bend_rad));

  ordered_json readings;
  double rate_radps = 0;
  Series series = study.OpenSeries("eq31", {"length_mm", "x_m", "z_m"});
  for (const BodyParameters& parameters : {Body60(), Body90()}) {
    const Body body(parameters);
    const model::InverseKinematics ik(body, 2.6);
    const auto at = [&](double t) { return ik.Solve(CircleTip(t), BendingVector::Zero(2)); };
    const auto start = at(0), later = at(1);
    BendingVector arc(2);
    arc << kCircleBend_rad, 0;
    const Vector3d own = ik.Tip(arc);
    for (int i = 1; i <= 40; ++i) {  // the backbone, as the tips of shorter robots of the same curvature
      BodyParameters part = parameters;
      const double share = i / 40.0;
      for (auto& s : part.sections) s.unit_length_m *= share;
      const Vector3d p = model::InverseKinematics(Body(part), 2.6).Tip(share * arc);
      series.row().Put(std::round(1e3 * parameters.length_m())).Put(p.x()).Put(p.z()).EndRow();
    }
    readings[fmt::format("{:.0f} mm robot", 1e3 * parameters.length_m())] = {
        {"bend of the nearest tip [rad]", start.us_vs.norm()},
        {"distance to eq. 31 [mm]", 1e3 * start.distance_m},
        {"radius at pi/3 [mm]", 1e3 * own.x()},
        {"height at pi/3 [mm]", 1e3 * own.z()}};
    rate_radps = std::atan2(later.us_vs[1], later.us_vs[0]) - std::atan2(start.us_vs[1], start.us_vs[0]);
  }
  const bool bend_ok = Apart(bend_rad, kCircleBend_rad) < 1e-4;
  study.Add(
      {.id = "eq31_bend",
       .section = "5.2",
       .figure = "eq. 31",
       .what = "bend on the circle is constant, pi/3",
       .says = "On the circle of eq. 31 the robot is bent by a constant angle of pi/3.",
       .paper = "pi/3 = 1.0472 rad",
       .ours = fmt::format("{:.5f} rad", bend_rad),
       .paper_value = kCircleBend_rad,
       .our_value = bend_rad,
       .unit = "rad",
       .verdict = bend_ok ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason =
           "Radius and height of eq. 31 fix the bend whatever the length: theta = 2 atan2(radius, height), "
           "which is eq. 5 without its 0/0 at beta = 0.",
       .readings = readings,
       .plot = "eq31"});
  study.Add({.id = "eq31_length",
             .section = "5.2",
             .figure = "eq. 31",
             .what = "the robot is 90 mm long",
             .says = "The robot that draws the circle of eq. 31 is 90 mm long.",
             .paper = fmt::format("{:.0f} mm", 1e3 * kTextLength_m),
             .ours = fmt::format("{:.4f} mm", 1e3 * length_m),
             .paper_value = 1e3 * kTextLength_m,
             .our_value = 1e3 * length_m,
             .unit = "mm",
             .verdict = Apart(length_m, kTextLength_m) < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
             .reason = fmt::format("Radius times theta over (1 - cos theta) is the arc's length: eq. 31 "
                                   "belongs to a {:.0f} mm robot. Table 1 "
                                   "(4 units of 22.5 mm) and section 5 say 90 mm; such a robot cannot come "
                                   "nearer than {:.1f} mm to the "
                                   "circle.",
                                   1e3 * length_m,
                                   readings["90 mm robot"]["distance to eq. 31 [mm]"].get<double>()),
             .readings = readings,
             .plot = "eq31"});
  study.Add(
      {.id = "eq31_rate",
       .section = "5.2",
       .figure = "eq. 31",
       .what = "the circle turns at 0.53 rad/s",
       .says = "The bending plane turns at 0.53 rad/s.",
       .paper = fmt::format("{:.2f} rad/s", kTextRate_radps),
       .ours = fmt::format("{:.4f} rad/s", rate_radps),
       .paper_value = kTextRate_radps,
       .our_value = rate_radps,
       .unit = "rad/s",
       .verdict = std::abs(rate_radps - kTextRate_radps) < 0.005 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "Eq. 31 itself turns at pi/6 rad/s, which rounds to 0.52; the text's number is {:.1f} % "
           "higher, one revolution in {:.2f} instead of {:.0f} s.",
           100 * (kTextRate_radps / rate_radps - 1), 2 * kPi / kTextRate_radps, 2 * kPi / rate_radps),
       .readings = ordered_json::object(),
       .plot = ""});
}

namespace {

// ---- simulations of the body ----

model::TensionProfile Constant(const VectorXd& tension_N, double until_s) {
  model::TensionProfile p{VectorXd(2), MatrixXd(tension_N.size(), 2)};
  p.time_s << 0, until_s;
  p.tension_N << tension_N, tension_N;
  return p;
}

// The same bend of every unit.
VectorXd Bent(const Body& body, double theta_rad, double beta_rad) {
  VectorXd q(body.dof());
  for (int i = 0; i < body.units(); ++i) {
    q.segment<2>(2 * i) << theta_rad * std::cos(beta_rad), theta_rad * std::sin(beta_rad);
  }
  return q;
}

std::vector<std::string> UnitColumns(const Body& body) {
  return std::vector<std::string>{"t_s"} + Numbered("u", body.units()) + Numbered("v", body.units());
}

void PutState(Series& series, double t_s, const VectorXd& q) {
  series.row().Put(t_s);
  for (int part = 0; part < 2; ++part) {
    for (Eigen::Index i = part; i < q.size(); i += 2) series.row().Put(q[i]);
  }
  series.row().EndRow();
}

// Energy of body and constant tensions: what is conserved without damping.
double TotalEnergy(const Body& body, const VectorXd& tension_N, const VectorXd& q, const VectorXd& dq,
                   Body::Workspace& workspace) {
  VectorXd length_m(body.tendons());
  body.TendonLengths(q, length_m);
  return body.EnergyOf(q, dq, workspace).total() + tension_N.dot(length_m);
}

struct Placement {
  const char* name;
  Vector3d gravity_direction;
};
// The paper does not say how the robot is mounted. The straight robot points along +z, tendon 1 bends it to
// +x.
const Placement kPlacements[] = {{"upright", {0, 0, -1}},
                                 {"hanging", {0, 0, 1}},
                                 {"horizontal, bends upwards", {-1, 0, 0}},
                                 {"horizontal, bends downwards", {1, 0, 0}},
                                 {"horizontal, bends sideways", {0, -1, 0}}};

BodyParameters Placed(BodyParameters p, const Placement& placement) {
  p.gravity_W_mps2 = p.gravity_W_mps2.norm() * placement.gravity_direction;
  return p;
}

// ---- 3.1 ----

constexpr double kZeroTensionStart_rad = 1e-4;  // 3.1
constexpr double kLongRun_s = 20;

// Free small motion in the bending plane from rest: amplitude of mode k in unit i, a_ki, so that
// u_i(t) = sum_k a_ki cos(2 pi f_k t).
struct PlanarModes {
  VectorXd frequency_Hz;
  MatrixXd amplitude_rad;  // modes x units
};

PlanarModes ModesOf(const Body& body, const VectorXd& equilibrium_q, const VectorXd& start_q) {
  const int n = body.units();
  Body::Workspace workspace(body);
  MatrixXd k_all(2 * n, 2 * n), h_all(2 * n, 2 * n);
  body.TangentStiffness(equilibrium_q, VectorXd::Zero(body.tendons()), Vector3d::Zero(), k_all);
  body.MassMatrix(equilibrium_q, h_all, workspace);
  const auto every_second = Eigen::seqN(0, n, Eigen::fix<2>);
  const MatrixXd k = k_all(every_second, every_second), h = h_all(every_second, every_second);
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> modes(k, h);
  const VectorXd start = (start_q - equilibrium_q)(every_second);
  const VectorXd share = modes.eigenvectors().transpose() * (h * start);
  return {modes.eigenvalues().cwiseSqrt() / (2 * kPi), share.asDiagonal() * modes.eigenvectors().transpose()};
}

struct FreeMotion {
  double energy_drift = 0;        // largest, relative to the energy of the motion
  double total_energy_drift = 0;  // relative to all energy, gravity counted from the base
  double largest_v_rad = 0;
  VectorXd mean_rad, least_rad, most_rad;  // of each unit's u
  int zero_crossings = 0;                  // of unit 1
};

FreeMotion RunFree(Study& study, const Body& body, const VectorXd& start_q, const VectorXd& rest_q,
                   double until_s, double tolerance, const std::string& series_name) {
  const int n = body.units();
  const VectorXd none = VectorXd::Zero(body.tendons()), still = VectorXd::Zero(body.dof());
  Body::Workspace workspace(body);
  const double rest_J = TotalEnergy(body, none, rest_q, still, workspace);
  const double start_J = TotalEnergy(body, none, start_q, still, workspace);
  FreeMotion out;
  out.mean_rad = VectorXd::Zero(n);
  out.least_rad = out.most_rad = start_q(Eigen::seqN(0, n, Eigen::fix<2>));
  std::optional<Series> series;
  if (!series_name.empty()) series.emplace(study.OpenSeries(series_name, UnitColumns(body)));
  std::int64_t samples = 0;
  double last_u1 = start_q[0];
  model::Simulate(body, Constant(none, until_s), start_q, still, 1e-3, tolerance,
                  [&](double t_s, model::ConstVectorRef q, model::ConstVectorRef dq) {
                    ++samples;
                    const VectorXd u = q(Eigen::seqN(0, n, Eigen::fix<2>));
                    const VectorXd v = q(Eigen::seqN(1, n, Eigen::fix<2>));
                    out.mean_rad += u;
                    out.least_rad = out.least_rad.cwiseMin(u);
                    out.most_rad = out.most_rad.cwiseMax(u);
                    out.largest_v_rad = std::max(out.largest_v_rad, v.lpNorm<Eigen::Infinity>());
                    out.zero_crossings += (u[0] > 0) != (last_u1 > 0);
                    last_u1 = u[0];
                    const double drift_J = std::abs(TotalEnergy(body, none, q, dq, workspace) - start_J);
                    out.energy_drift = std::max(out.energy_drift, drift_J / (start_J - rest_J));
                    out.total_energy_drift = std::max(out.total_energy_drift, drift_J / std::abs(start_J));
                    if (series && t_s < 2 + 1e-9) PutState(*series, t_s, q);
                    if (samples % 256 == 0) study.Progress(t_s / until_s);
                  });
  out.mean_rad /= static_cast<double>(samples);
  return out;
}

}  // namespace

void ZeroTension(Study& study) {
  study.Begin("3.1: zero tension, free motion");
  const BodyParameters parameters = Body90();
  const Body body(parameters);
  const int n = body.units();
  const VectorXd straight = VectorXd::Zero(body.dof()), start = Bent(body, kZeroTensionStart_rad, 0);
  const FreeMotion free = RunFree(study, body, start, straight, kLongRun_s, 1e-11, "zero_tension");
  const PlanarModes modes = ModesOf(body, straight, start);

  // Share of each unit's variance that is not the first mode.
  ordered_json shares;
  double least_other = 1, most_other = 0;
  for (int i = 0; i < n; ++i) {
    const double other =
        1 - modes.amplitude_rad.col(i).cwiseAbs2()[0] / modes.amplitude_rad.col(i).squaredNorm();
    least_other = std::min(least_other, other);
    most_other = std::max(most_other, other);
    ordered_json& row = shares[fmt::format("unit {}", i + 1)];
    for (int k = 0; k < n; ++k) {
      row[fmt::format("{:.1f} Hz [1e-6 rad]", modes.frequency_Hz[k])] = 1e6 * modes.amplitude_rad(k, i);
    }
    row["not in the first mode [% of variance]"] = 100 * other;
  }
  std::string frequencies;
  for (int k = 0; k < n; ++k)
    frequencies += fmt::format("{}{:.2f}", k == 0 ? "" : ", ", modes.frequency_Hz[k]);
  study.Add({.id = "3.1_sinusoid",
             .section = "3.1",
             .figure = "Fig. 4a",
             .what = "each unit's bend is a sinusoid",
             .says = "Without tension each unit's bending angle varies as a sinusoid.",
             .paper = "one sinusoid",
             .ours = fmt::format("{} modes", n),
             .paper_value = 1,
             .our_value = n,
             .unit = "modes",
             .verdict = most_other < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
             .reason = fmt::format(
                 "Four units have four modes in a plane ({} Hz), and equal angles excite all of them: {:.0f} "
                 "to {:.0f} % of a unit's variance is not in the first. So it is no sinusoid, and not even "
                 "periodic.",
                 frequencies, 100 * least_other, 100 * most_other),
             .readings = shares,
             .plot = "fig4"});

  ordered_json means;
  double sag_rad = 0;
  for (const auto& [length_name, base] : {std::pair{"90 mm", Body90()}, std::pair{"60 mm", Body60()}}) {
    for (const Placement& placement : {kPlacements[0], kPlacements[1], kPlacements[3]}) {
      const Body placed(Placed(base, placement));
      const auto rest = model::SolveStatics(placed, VectorXd::Zero(placed.tendons()), Vector3d::Zero());
      const FreeMotion f = RunFree(study, placed, start, rest.q, 2, 1e-10, "");
      const double largest = rest.q.lpNorm<Eigen::Infinity>();
      if (placed.parameters().gravity_W_mps2.x() != 0) sag_rad = std::max(sag_rad, largest);
      const PlanarModes placed_modes = ModesOf(placed, rest.q, start);
      means[fmt::format("{}, {}", placement.gravity_direction.x() != 0 ? "horizontal" : placement.name,
                        length_name)] = {{"first mode [Hz]", placed_modes.frequency_Hz[0]},
                                         {"fixed value, unit 1 [1e-6 rad]", 1e6 * rest.q[0]},
                                         {"fixed value, unit 4 [1e-6 rad]", 1e6 * rest.q[2 * (n - 1)]},
                                         {"least, unit 1 [1e-6 rad]", 1e6 * f.least_rad[0]},
                                         {"most, unit 1 [1e-6 rad]", 1e6 * f.most_rad[0]}};
    }
  }
  const double mean_rad = free.mean_rad.lpNorm<Eigen::Infinity>();
  study.Add(
      {.id = "3.1_fixed_value",
       .section = "3.1",
       .figure = "Fig. 4",
       .what = "about a fixed value, an equilibrium",
       .says = "The angles, and with them the robot's shape, oscillate about a fixed equilibrium value.",
       .paper = "a fixed value",
       .ours = fmt::format("0 (mean {:.1e} rad)", mean_rad),
       .paper_value = std::nullopt,
       .our_value = mean_rad,
       .unit = "rad",
       .verdict = mean_rad < 0.02 * kZeroTensionStart_rad ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format("Upright and hanging the fixed value is zero, the straight robot: unit 1 "
                             "crosses it {} times in {:.0f} s, "
                             "where the paper's pair (theta >= 0, beta) breaks down; we use (u, v) = theta "
                             "(cos beta, sin beta). Only "
                             "lying horizontally is it another value, a sag of up to {:.3f} rad a unit.",
                             free.zero_crossings, kLongRun_s, sag_rad),
       .readings = means,
       .plot = "fig4"});

  study.Add(
      {.id = "3.1_beta",
       .section = "3.1",
       .figure = "Fig. 4",
       .what = "the bending plane's angle stays 0",
       .says = "The rotation angle beta is 0 at all times.",
       .paper = "0 rad",
       .ours = fmt::format("{:.1g} rad", free.largest_v_rad),
       .paper_value = 0,
       .our_value = free.largest_v_rad,
       .unit = "rad",
       .verdict = free.largest_v_rad < 1e-15 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "No force leaves the plane, so the out-of-plane bend v stays zero over {:.0f} s. Read with theta "
           ">= 0, beta jumps between 0 and pi at each crossing.",
           kLongRun_s),
       .readings = ordered_json::object(),
       .plot = "fig4"});

  study.Begin("3.1: energy of a large free motion");
  const double large_rad = kPi / 12;
  const FreeMotion large = RunFree(study, body, Bent(body, large_rad, 0), straight, kLongRun_s, 1e-12, "");
  study.Add(
      {.id = "3.1_energy",
       .section = "3.1",
       .figure = "",
       .what = "total energy stays constant",
       .says = "The system's total energy never changes.",
       .paper = "constant",
       .ours = fmt::format("drift {:.1e}", free.total_energy_drift),
       .paper_value = 0,
       .our_value = free.total_energy_drift,
       .unit = "relative",
       .verdict = std::max(free.total_energy_drift, large.energy_drift) < 1e-9 ? Verdict::kConfirmed
                                                                               : Verdict::kDiffers,
       .reason = fmt::format(
           "Largest change in {:.0f} s relative to the total energy; for the same motion from pi/12, large "
           "enough to measure its own energy above rounding, {:.1e} of that energy.",
           kLongRun_s, large.energy_drift),
       .readings = {{"from 1e-4 rad",
                     {{"drift / total energy", free.total_energy_drift},
                      {"drift / energy of the motion", free.energy_drift}}},
                    {"from pi/12 rad",
                     {{"drift / total energy", large.total_energy_drift},
                      {"drift / energy of the motion", large.energy_drift}}}},
       .plot = ""});
}

namespace {

// ---- 3.2 ----

constexpr double kPull_N = 5, kPullStart_rad = kPi / 12, kPullStartBeta_rad = 0.001;  // 3.2
constexpr double kPaperEquilibrium_rad = kPi / 6;                                     // Fig. 5b
constexpr double kWireRadius_m = 0.0004;  // section 5: a wire of 0.8 mm diameter; table 1: a radius of 0.5 mm
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

}  // namespace

void SingleTendon(Study& study) {
  const BodyParameters parameters = Body90();
  const Body body(parameters);
  const int n = body.units();
  VectorXd tension = VectorXd::Zero(body.tendons());
  tension[0] = kPull_N;
  // The paper has no damping; the nominal rig's is the one we add and state.
  const double damping_Nms =
      config::LoadRobot(ConfigFile("robots/rig_90mm.yaml")).body.sections[0].bending_damping_Nms;

  study.Begin("3.2: 5 N on tendon 1, undamped");
  const auto rest = model::SolveStatics(body, tension, Vector3d::Zero());
  if (rest.result != model::StaticsResult::kConverged)
    throw std::runtime_error("3.2: the upright 90 mm robot has no equilibrium under 5 N");
  const PulledMotion undamped = RunPulled(study, body, rest.q, kLongRun_s, 1e-10, "pull_undamped");

  study.Begin("3.2: the same with damping");
  ordered_json dampings;
  PulledMotion damped;
  for (const double factor : {0.0, 0.5, 1.0, 2.0}) {
    const Body b(Damped(parameters, factor * damping_Nms));
    const PulledMotion m =
        factor == 0 ? undamped : RunPulled(study, b, rest.q, 20, 1e-9, factor == 1 ? "pull_damped" : "");
    if (factor == 1) damped = m;
    dampings[fmt::format("damping {:.1e} N m s/rad", factor * damping_Nms)] = {
        {"within 1e-3 rad after [s]", factor == 0 ? ordered_json("never") : ordered_json(m.settled_s)},
        {"swing of unit 1, first 2 s [rad]", m.first_swing_rad[0]},
        {"swing of unit 1, last 2 s [rad]", m.last_swing_rad[0]},
        {"swing of unit 4, first 2 s [rad]", m.first_swing_rad[n - 1]},
        {"swing of unit 4, last 2 s [rad]", m.last_swing_rad[n - 1]},
        {"energy of the motion left [%]", 100 * m.energy_left}};
  }
  const double remaining = undamped.last_swing_rad[0] / undamped.first_swing_rad[0];
  study.Add(
      {.id = "3.2_convergence",
       .section = "3.2",
       .figure = "Fig. 5",
       .what = "the motion converges",
       .says =
           "Under 5 N on tendon 1, from pi/12 a unit, the angles swing and converge to a stable position.",
       .paper = "converges",
       .ours = fmt::format("{:.0f} % swing left at {:.0f} s", 100 * remaining, kLongRun_s),
       .paper_value = 0,
       .our_value = undamped.last_swing_rad[0],
       .unit = "rad",
       .verdict = remaining > 0.5 ? Verdict::kNotAsStated : Verdict::kConfirmed,
       .reason = fmt::format(
           "Eqs. 13 to 25 contain nothing that dissipates: after {:.0f} s unit 1 still swings by ±{:.3f} rad "
           "(±{:.3f} at "
           "first) and {:.4f} % of the motion's energy is left. The paper blames the transmission's "
           "friction, which its "
           "simulation does not contain; its figure must have damping that is not stated, or the solver's. "
           "With {:.0e} "
           "N m s/rad a unit, our addition, all units are within 1e-3 rad of rest after {:.1f} s.",
           kLongRun_s, undamped.last_swing_rad[0], undamped.first_swing_rad[0], 100 * undamped.energy_left,
           damping_Nms, damped.settled_s),
       .readings = dampings,
       .plot = "fig5"});

  study.Begin("3.2: orientations and lengths");
  ordered_json readings, orders;
  const auto read = [&](const std::string& name, const BodyParameters& p) {
    const Body b(Damped(p, damping_Nms));
    const auto e = model::SolveStatics(b, tension, Vector3d::Zero());
    ordered_json& row = readings[name];
    if (e.result != model::StaticsResult::kConverged) {
      for (int i = 1; i <= n; ++i) row[fmt::format("unit {} [rad]", i)] = "none";
      return;
    }
    const PulledMotion m = RunPulled(study, b, e.q, 20, 1e-9, "");
    VectorXd theta(n);
    for (int i = 0; i < n; ++i) theta[i] = m.end_q.segment<2>(2 * i).norm();
    for (int i = 0; i < n; ++i) row[fmt::format("unit {} [rad]", i + 1)] = theta[i];
    row["mean / (pi/6)"] = theta.mean() / kPaperEquilibrium_rad;
    row["whole robot [rad]"] = m.end_q(Eigen::seqN(0, n, Eigen::fix<2>)).sum();
    row["falls from base to tip"] = Falls(theta) ? "yes" : "no";
    row["end of motion less equilibrium [rad]"] = (m.end_q - e.q).lpNorm<Eigen::Infinity>();
  };
  for (const auto& [length_name, base] : {std::pair{"90 mm", Body90()}, std::pair{"60 mm", Body60()}}) {
    for (const Placement& placement : kPlacements) {
      read(fmt::format("{}, {}", placement.name, length_name), Placed(base, placement));
    }
  }
  BodyParameters thin = parameters;
  for (auto& s : thin.sections) s.core_radius_m = kWireRadius_m;
  read("upright, 90 mm, wire of 0.8 mm as in section 5", thin);

  VectorXd theta(n);
  for (int i = 0; i < n; ++i) theta[i] = damped.end_q.segment<2>(2 * i).norm();
  const double mean_rad = theta.mean(), apart = Apart(mean_rad, kPaperEquilibrium_rad);
  double least_elsewhere = 1e9, most_elsewhere = 0;
  int fall = 0, rise = 0;
  std::string risers;
  for (const auto& [name, row] : readings.items()) {
    if (!row.contains("mean / (pi/6)")) continue;
    const double ratio = row["mean / (pi/6)"];
    if (name != "upright, 90 mm") {
      least_elsewhere = std::min(least_elsewhere, ratio);
      most_elsewhere = std::max(most_elsewhere, ratio);
    }
    const bool falls = row["falls from base to tip"] == "yes";
    ++(falls ? fall : rise);
    if (!falls) risers += (risers.empty() ? "" : "; ") + name;
  }
  study.Add({.id = "3.2_equilibrium",
             .section = "3.2",
             .figure = "Fig. 5b",
             .what = "equilibrium at pi/6 a unit",
             .says = "The robot's shape converges to the equilibrium with a bending angle of pi/6.",
             .paper = "pi/6 = 0.5236 rad",
             .ours = fmt::format("{:.4f} rad, mean", mean_rad),
             .paper_value = kPaperEquilibrium_rad,
             .our_value = mean_rad,
             .unit = "rad",
             .verdict = apart < 0.05 ? Verdict::kConfirmed : Verdict::kDiffers,
             .reason = fmt::format("With the damping stated, upright and 90 mm long, the units come to rest "
                                   "at {} rad, {:.1f} % from pi/6 on "
                                   "average; pi/6 is the angle of a unit (the whole robot bends by {:.2f} "
                                   "rad). Every other reading is farther "
                                   "away: {:.2f} to {:.2f} times pi/6.",
                                   Listed(theta, 4), 100 * (mean_rad / kPaperEquilibrium_rad - 1),
                                   theta.sum(), least_elsewhere, most_elsewhere),
             .readings = readings,
             .plot = "fig5_readings"});
  for (const auto& [name, m] :
       {std::pair{"undamped, peak", undamped.peak_rad},
        std::pair{"undamped, swing in the first 2 s", undamped.first_swing_rad},
        std::pair{"damped, peak", damped.peak_rad}, std::pair{"damped, at rest", theta}}) {
    for (int i = 0; i < n; ++i) orders[name][fmt::format("unit {} [rad]", i + 1)] = m[i];
    orders[name]["falls from base to tip"] = Falls(m) ? "yes" : "no";
  }
  study.Add({.id = "3.2_order",
             .section = "3.2",
             .figure = "Fig. 5a",
             .what = "angles fall from base to tip",
             .says = "From the first to the last unit the bending angles become smaller.",
             .paper = "fall",
             .ours = Falls(theta) ? "fall" : "do not fall",
             .paper_value = std::nullopt,
             .our_value = theta[n - 1] / theta[0],
             .unit = "last / first",
             .verdict = Falls(theta) && Falls(damped.peak_rad) ? Verdict::kConfirmed : Verdict::kDiffers,
             .reason = fmt::format("At rest {} rad (last / first {:.3f}), at the first peak {} rad: gravity "
                                   "adds most at the base of an "
                                   "upright robot. It holds for {} of {} readings{}{}.",
                                   Listed(theta, 3), theta[n - 1] / theta[0], Listed(damped.peak_rad, 3),
                                   fall, fall + rise, risers.empty() ? "" : ", not for: ", risers),
             .readings = orders,
             .plot = "fig5"});
  study.Add(
      {.id = "3.2_beta",
       .section = "3.2",
       .figure = "Fig. 5",
       .what = "the motion stays in one plane",
       .says = "Under one tendon the robot moves in a plane and beta stays 0, although it starts at 0.001.",
       .paper = "0 rad",
       .ours = fmt::format("|v| <= {:.1e} rad", undamped.largest_v_rad),
       .paper_value = 0,
       .our_value = undamped.largest_v_rad,
       .unit = "rad",
       .verdict = undamped.largest_v_rad < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "The start leans out of the plane by {:.1e} rad a unit; undamped it sways between such values and "
           "grows to {:.1e} rad at most in {:.0f} s; damped it dies out.",
           kPullStart_rad * kPullStartBeta_rad, undamped.largest_v_rad, kLongRun_s),
       .readings = ordered_json::object(),
       .plot = ""});
}

}  // namespace tendril::tools::reproduce
