// 3.1, Fig. 4: no tension, the robot swings freely.
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <optional>

#include "body_motion.h"
#include "figures.h"
#include "paper.h"
#include "tendril/model/statics.h"

namespace tendril::qi2021 {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using model::Body;
using nlohmann::ordered_json;

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

void Sinusoid(Study& study, const PlanarModes& modes, int n) {
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
  study.Find(
      "3.1_sinusoid",
      {.ours = fmt::format("{} modes", n),
       .our_value = n,
       .verdict = most_other < 0.01 ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "Four units have four modes in a plane ({} Hz), and equal angles excite all of them: {:.0f} to "
           "{:.0f} % of a unit's variance is not in the first. So it is no sinusoid, and not even periodic.",
           frequencies, 100 * least_other, 100 * most_other),
       .readings = shares});
}

void FixedValue(Study& study, const FreeMotion& free, const VectorXd& start) {
  ordered_json means;
  double sag_rad = 0;
  for (const auto& [length_name, file] :
       {std::pair{"90 mm", "robots/qi2021_90mm.yaml"}, std::pair{"60 mm", "robots/qi2021_60mm.yaml"}}) {
    for (const Placement& placement : {kPlacements[0], kPlacements[1], kPlacements[3]}) {
      const Body placed(Placed(study.Robot(file).body, placement));
      const auto rest = model::SolveStatics(placed, VectorXd::Zero(placed.tendons()), Vector3d::Zero());
      const FreeMotion f = RunFree(study, placed, start, rest.q, 2, 1e-10, "");
      const double largest = rest.q.lpNorm<Eigen::Infinity>();
      if (placed.parameters().gravity_W_mps2.x() != 0) sag_rad = std::max(sag_rad, largest);
      const PlanarModes placed_modes = ModesOf(placed, rest.q, start);
      const char* name = placement.gravity_direction.x() != 0 ? "horizontal" : placement.name;
      means[fmt::format("{}, {}", name, length_name)] = {
          {"first mode [Hz]", placed_modes.frequency_Hz[0]},
          {"fixed value, unit 1 [1e-6 rad]", 1e6 * rest.q[0]},
          {"fixed value, unit 4 [1e-6 rad]", 1e6 * rest.q[2 * (placed.units() - 1)]},
          {"least, unit 1 [1e-6 rad]", 1e6 * f.least_rad[0]},
          {"most, unit 1 [1e-6 rad]", 1e6 * f.most_rad[0]}};
    }
  }
  const double mean_rad = free.mean_rad.lpNorm<Eigen::Infinity>();
  study.Find(
      "3.1_fixed_value",
      {.ours = fmt::format("0 (mean {:.1e} rad)", mean_rad),
       .our_value = mean_rad,
       .verdict = mean_rad < 0.02 * kZeroTensionStart_rad ? Verdict::kConfirmed : Verdict::kDiffers,
       .reason = fmt::format(
           "Upright and hanging the fixed value is zero, the straight robot: unit 1 crosses it {} times in "
           "{:.0f} s, where the paper's pair (theta >= 0, beta) breaks down; we use (u, v) = theta (cos "
           "beta, sin beta). Only lying horizontally is it another value, a sag of up to {:.3f} rad a unit.",
           free.zero_crossings, kLongRun_s, sag_rad),
       .readings = means});
}

}  // namespace

void ZeroTension(Study& study) {
  study.Begin("3.1: zero tension, free motion");
  const Body body(study.Robot("robots/qi2021_90mm.yaml").body);
  const VectorXd straight = VectorXd::Zero(body.dof()), start = Bent(body, kZeroTensionStart_rad, 0);
  const FreeMotion free = RunFree(study, body, start, straight, kLongRun_s, 1e-11, "zero_tension");
  Sinusoid(study, ModesOf(body, straight, start), body.units());
  FixedValue(study, free, start);
  study.Find("3.1_beta", {.ours = fmt::format("{:.1g} rad", free.largest_v_rad),
                          .our_value = free.largest_v_rad,
                          .verdict = free.largest_v_rad < 1e-15 ? Verdict::kConfirmed : Verdict::kDiffers,
                          .reason = fmt::format(
                              "No force leaves the plane, so the out-of-plane bend v stays zero over {:.0f} "
                              "s. Read with theta >= 0, beta jumps between 0 and pi at each crossing.",
                              kLongRun_s)});

  study.Begin("3.1: energy of a large free motion");
  const double large_rad = kPi / 12;
  const FreeMotion large = RunFree(study, body, Bent(body, large_rad, 0), straight, kLongRun_s, 1e-12, "");
  study.Find("3.1_energy",
             {.ours = fmt::format("drift {:.1e}", free.total_energy_drift),
              .our_value = free.total_energy_drift,
              .verdict = std::max(free.total_energy_drift, large.energy_drift) < 1e-9 ? Verdict::kConfirmed
                                                                                      : Verdict::kDiffers,
              .reason = fmt::format(
                  "Largest change in {:.0f} s relative to the total energy; for the same motion from pi/12, "
                  "large enough to measure its own energy above rounding, {:.1e} of that energy.",
                  kLongRun_s, large.energy_drift),
              .readings = {{"from 1e-4 rad",
                            {{"drift / total energy", free.total_energy_drift},
                             {"drift / energy of the motion", free.energy_drift}}},
                           {"from pi/12 rad",
                            {{"drift / total energy", large.total_energy_drift},
                             {"drift / energy of the motion", large.energy_drift}}}}});
}

}  // namespace tendril::qi2021
