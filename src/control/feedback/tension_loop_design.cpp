#include "tendril/control/tension_loop_design.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "tendril/model/bending_model.h"
#include "tendril/model/body.h"
#include "tendril/model/pull_cone.h"

namespace tendril::control {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The body linearised at an arc, under the tensions that hold it.
struct LinearBody {
  MatrixXd mass, damping, stiffness, shortening;  // shortening: M x 2N
};

LinearBody Linearise(const model::Body& body, double bend_rad, double min_tension_N) {
  const int n = body.dof(), m = body.tendons();
  VectorXd us_vs = VectorXd::Zero(2 * body.sections()), q(n), force(n);
  for (int k = 0; k < body.sections(); ++k) {
    const model::PullCone cone = model::PullConeOf(body.parameters(), k);
    const double angle_rad = cone.kind == model::PullCone::Kind::kPlane ? 0 : cone.from_rad;
    us_vs.segment<2>(2 * k) << bend_rad * std::cos(angle_rad), bend_rad * std::sin(angle_rad);
  }
  body.SpreadBending(us_vs, q);
  LinearBody linear{MatrixXd(n, n), MatrixXd::Zero(n, n), MatrixXd(n, n), MatrixXd(m, n)};
  body.TendonLengthJacobian(q, linear.shortening);
  linear.shortening = -linear.shortening;
  body.StaticForce(q, Eigen::Vector3d::Zero(), force);
  // Equal tensions bend nothing, so the routes have rank two per section; the threshold rejects rounding
  // beyond that.
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> routes;
  routes.setThreshold(1e-8);
  routes.compute(linear.shortening.transpose());
  const VectorXd tension = (VectorXd(routes.solve(force)).array().max(0) + min_tension_N).matrix();
  model::Body::Workspace workspace(body);
  body.MassMatrix(q, linear.mass, workspace);
  body.TangentStiffness(q, tension, Eigen::Vector3d::Zero(), linear.stiffness);
  int i = 0;
  for (const SectionParameters& s : body.parameters().sections) {
    for (int unit = 0; unit < s.units; ++unit, i += 2)
      linear.damping.diagonal().segment<2>(i).setConstant(s.bending_damping_Nms);
  }
  return linear;
}

// Model reduction to the modes that a loop through the tendons meets: the body's slowest modes, the static
// deflection by each tendon, and the deflection by the inertia of that. For 10 and 20 units the margins agree
// to four digits.
LinearBody Reduced(const LinearBody& full, int sections, double tendon_stiffness_Npm) {
  constexpr int kModesPerSection = 8;
  const auto n = full.mass.rows(), m = full.shortening.rows();
  const auto slow = static_cast<Eigen::Index>(kModesPerSection) * sections;
  if (n <= slow + 2 * m) return full;
  MatrixXd ways(n, slow + 2 * m);
  ways.leftCols(slow) = Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(full.stiffness, full.mass)
                            .eigenvectors()
                            .leftCols(slow);
  const Eigen::LDLT<MatrixXd> held(full.stiffness +
                                   tendon_stiffness_Npm * full.shortening.transpose() * full.shortening);
  ways.middleCols(slow, m) = held.solve(full.shortening.transpose());
  ways.rightCols(m) = held.solve(full.mass * ways.middleCols(slow, m));
  // Orthonormal in the mass metric, without duplicates.
  const MatrixXd root = Eigen::LLT<MatrixXd>(full.mass).matrixU();
  MatrixXd spanned = root * ways;
  spanned.colwise().normalize();
  Eigen::ColPivHouseholderQR<MatrixXd> qr(spanned);
  qr.setThreshold(1e-8);
  const MatrixXd basis = root.triangularView<Eigen::Upper>().solve(
      MatrixXd(qr.householderQ() * MatrixXd::Identity(n, qr.rank())));
  return {basis.transpose() * full.mass * basis, basis.transpose() * full.damping * basis,
          basis.transpose() * full.stiffness * basis, full.shortening * basis};
}

MatrixXd Exponential(MatrixXd a) {
  const double norm = a.cwiseAbs().rowwise().sum().maxCoeff();
  const int halvings = std::max(0, static_cast<int>(std::ceil(std::log2(std::max(norm, 1e-300)))) + 4);
  a /= std::pow(2.0, halvings);
  const MatrixXd one = MatrixXd::Identity(a.rows(), a.cols());
  MatrixXd sum = one, term = one;
  for (int i = 1; i <= 10; ++i) {
    term = term * a / i;
    sum += term;
  }
  for (int i = 0; i < halvings; ++i) sum = sum * sum;
  return sum;
}

// Rig and feedback as one linear map from cycle to cycle, x' = A x + B r, with r torques added at the drives
// and u = C x the feedback's torques. Order of x: q, dq, motor angles, velocities, torques; then the torques
// sent last and the controller's filtered error, integral, filtered velocity and last angles.
class LinearRig {
 public:
  LinearRig(RobotParameters robot, double bend_rad, double period_s)
      : robot_(model::ControlModel(std::move(robot))), m_(robot_.body.tendons()), period_s_(period_s) {
    const model::Body body(robot_.body);
    body_ = Reduced(Linearise(body, bend_rad, robot_.limits.min_tension_N), body.sections(),
                    robot_.actuation->tendons[0].tendon.stiffness_Npm);
    n_ = static_cast<int>(body_.mass.rows());
    const int n = n_, m = m_, states = 2 * n + 3 * m;
    MatrixXd a = MatrixXd::Zero(states + m, states + m);
    const Eigen::LLT<MatrixXd> mass(body_.mass);
    cell_ = MatrixXd::Zero(m, states);
    for (int j = 0; j < m; ++j) {
      const auto& t = robot_.actuation->tendons[j];
      const double travel = t.SpoolTravelPerMotorRad(), k = t.tendon.stiffness_Npm, c = t.tendon.damping_Nspm;
      cell_.row(j).head(n) = -k * body_.shortening.row(j);
      cell_.row(j).segment(n, n) = -c * body_.shortening.row(j);
      cell_(j, 2 * n + j) = k * travel;
      cell_(j, 2 * n + m + j) = c * travel;
    }
    a.block(0, n, n, n).setIdentity();
    a.block(n, 0, n, states) = mass.solve(body_.shortening.transpose() * cell_);
    a.block(n, 0, n, n) -= mass.solve(body_.stiffness);
    a.block(n, n, n, n) -= mass.solve(body_.damping);
    for (int j = 0; j < m; ++j) {
      const auto& t = robot_.actuation->tendons[j];
      const int angle = 2 * n + j, velocity = angle + m, torque = velocity + m;
      a(angle, velocity) = 1;
      a.row(velocity).head(states) = -t.SpoolTravelPerMotorRad() / t.motor.rotor_inertia_kgm2 * cell_.row(j);
      a(velocity, velocity) -= t.motor.viscous_friction_Nms / t.motor.rotor_inertia_kgm2;
      a(velocity, torque) = 1 / t.motor.rotor_inertia_kgm2;
      const double lag_s = std::max(t.motor.torque_lag_s, 1e-5);
      a(torque, torque) = -1 / lag_s;
      a(torque, states + j) = 1 / lag_s;
    }
    const MatrixXd advanced = Exponential(a * period_s);
    advance_ = advanced.topLeftCorner(states, states);
    input_ = advanced.topRightCorner(states, m);
  }

  /// Stiffness of body and tendon against one tendon's pull, the softest [N/m].
  double Softest() const {
    const MatrixXd compliance =
        body_.shortening * body_.stiffness.ldlt().solve(MatrixXd(body_.shortening.transpose()));
    double softest = std::numeric_limits<double>::infinity();
    const double most = Eigen::SelfAdjointEigenSolver<MatrixXd>(compliance).eigenvalues().maxCoeff();
    for (const auto& t : robot_.actuation->tendons)
      softest = std::min(softest, 1 / (std::max(most, 0.0) + 1 / t.tendon.stiffness_Npm));
    return softest;
  }

  struct Loop {
    MatrixXd a, b, c;
  };
  Loop Close(const TensionLoopGains& g, double gain) const {
    const int s = static_cast<int>(advance_.rows()), m = m_;
    const int sent = s, error = s + m, integral = s + 2 * m, speed = s + 3 * m, last = s + 4 * m;
    const int all = s + 5 * m;
    // Controller at the sample: filtered values after this sample's measurement, as rows over x.
    MatrixXd filtered = MatrixXd::Zero(m, all), sum = filtered, velocity = filtered;
    const double cell_share = g.cell_filter_s > 0 ? 1 - std::exp(-period_s_ / g.cell_filter_s) : 1;
    const double velocity_share =
        g.velocity_filter_s > 0 ? 1 - std::exp(-period_s_ / g.velocity_filter_s) : 1;
    MatrixXd u = filtered;
    for (int j = 0; j < m; ++j) {
      filtered(j, error + j) = 1 - cell_share;
      filtered.row(j).head(s) -= cell_share * cell_.row(j);
      sum.row(j) = g.integral_ps * period_s_ * filtered.row(j);
      sum(j, integral + j) += 1;
      velocity(j, speed + j) = 1 - velocity_share;
      velocity(j, 2 * n_ + j) += velocity_share / period_s_;
      velocity(j, last + j) -= velocity_share / period_s_;
      const double travel = robot_.actuation->tendons[j].SpoolTravelPerMotorRad();
      u.row(j) =
          travel * (g.proportional * filtered.row(j) + sum.row(j)) - g.damping_Nms[j] * velocity.row(j);
    }
    Loop loop{MatrixXd::Zero(all, all), MatrixXd::Zero(all, m), u};
    loop.a.topLeftCorner(s, s) = advance_;
    loop.a.block(0, sent, s, m) = input_;
    loop.a.block(sent, 0, m, all) = gain * u;
    loop.b.block(sent, 0, m, m).setIdentity();
    loop.a.block(error, 0, m, all) = filtered;
    loop.a.block(integral, 0, m, all) = sum;
    loop.a.block(speed, 0, m, all) = velocity;
    for (int j = 0; j < m; ++j) loop.a(last + j, 2 * n_ + j) = 1;
    return loop;
  }

  bool Stable(const TensionLoopGains& g, double gain) const {
    const Eigen::EigenSolver<MatrixXd> modes(Close(g, gain).a, false);
    return modes.info() == Eigen::Success && modes.eigenvalues().cwiseAbs().maxCoeff() < 1 - 1e-9;
  }

  /// Smallest phase distance of any drive's loop from -1 where its gain is one.
  double PhaseMargin_deg(const TensionLoopGains& g) const {
    using Complex = std::complex<double>;
    // The closed loop is diagonalised once, so that each frequency is a sum. If T is the response of one
    // drive's torque through all loops, T / (1 + T) is its response with its own loop cut.
    const Loop closed = Close(g, 1);
    const int all = static_cast<int>(closed.a.rows());
    const Eigen::EigenSolver<MatrixXd> modes(closed.a);
    if (modes.info() != Eigen::Success) return 0;
    const Eigen::MatrixXcd vectors = modes.eigenvectors();
    const Eigen::MatrixXcd in = vectors.partialPivLu().solve(Eigen::MatrixXcd(closed.b.cast<Complex>()));
    const Eigen::MatrixXcd out = closed.c.cast<Complex>() * vectors;
    double least = 180;
    for (int j = 0; j < m_; ++j) {
      const Eigen::VectorXcd share = out.row(j).transpose().cwiseProduct(in.col(j));
      std::optional<Complex> before;
      constexpr int kPoints = 2000;
      const double lowest = 0.01, highest = std::numbers::pi / period_s_;
      for (int i = 0; i <= kPoints; ++i) {
        const double w = lowest * std::pow(highest / lowest, static_cast<double>(i) / kPoints);
        const Complex z = std::polar(1.0, w * period_s_);
        Complex through = 0;
        for (int k = 0; k < all; ++k) through += share[k] / (z - modes.eigenvalues()[k]);
        const Complex loop = -through / (1.0 + through);
        if (before && (std::abs(*before) - 1) * (std::abs(loop) - 1) <= 0) {
          const double angle = std::abs(std::arg(-loop));
          least = std::min(least, angle * 180 / std::numbers::pi);
        }
        before = loop;
      }
    }
    return least;
  }

 private:
  RobotParameters robot_;
  int n_ = 0, m_;  // degrees of freedom of the body, tendons
  double period_s_;
  LinearBody body_;
  MatrixXd cell_, advance_, input_;
};

// The operating range from straight to the greatest bend; and the same with tendons half and twice as stiff
// as the file states, an uncertainty that a gain margin does not cover.
struct Rigs {
  std::vector<LinearRig> nominal, perturbed;
};

Rigs RigsOf(const RobotParameters& robot, double period_s) {
  Rigs rigs;
  for (const double share : {0.0, 0.5, 1.0}) {
    const double bend_rad = share * robot.limits.max_bending_rad;
    rigs.nominal.emplace_back(robot, bend_rad, period_s);
    for (const double stiffer : {0.5, 2.0}) {
      RobotParameters other = robot;
      for (auto& t : other.actuation->tendons) t.tendon.stiffness_Npm *= stiffer;
      rigs.perturbed.emplace_back(std::move(other), bend_rad, period_s);
    }
  }
  return rigs;
}

TensionLoopGains GainsFor(const RobotParameters& robot, double bandwidth_radps, double softest_Npm) {
  TensionLoopGains g;
  g.bandwidth_radps = bandwidth_radps;
  double natural2 = 0;  // of rotor on body, without feedback
  for (const auto& t : robot.actuation->tendons) {
    const double travel = t.SpoolTravelPerMotorRad();
    natural2 = std::max(natural2, softest_Npm * travel * travel / t.motor.rotor_inertia_kgm2);
    g.damping_Nms.push_back(1.4 * bandwidth_radps * t.motor.rotor_inertia_kgm2);
  }
  g.proportional = std::max(0.0, bandwidth_radps * bandwidth_radps / natural2 - 1);
  g.integral_ps = (1 + g.proportional) * bandwidth_radps / 4;
  g.cell_filter_s = 1 / (4 * bandwidth_radps);
  g.velocity_filter_s = 1 / (8 * bandwidth_radps);
  return g;
}

bool Stable(const std::vector<LinearRig>& rigs, const TensionLoopGains& gains, double gain) {
  return std::all_of(rigs.begin(), rigs.end(), [&](const LinearRig& r) { return r.Stable(gains, gain); });
}

TensionLoopMargins Margins(const Rigs& rigs, const TensionLoopGains& gains) {
  TensionLoopMargins margins;
  margins.stable = Stable(rigs.nominal, gains, 1) && Stable(rigs.perturbed, gains, 1);
  if (!margins.stable) return margins;
  double low = 1, high = kMostGainMargin;
  if (Stable(rigs.nominal, gains, kMostGainMargin)) low = kMostGainMargin;
  for (int i = 0; i < 12 && low < kMostGainMargin; ++i) {
    const double middle = std::sqrt(low * high);
    (Stable(rigs.nominal, gains, middle) ? low : high) = middle;
  }
  margins.gain = low;
  margins.phase_deg = 180;
  for (const LinearRig& r : rigs.nominal)
    margins.phase_deg = std::min(margins.phase_deg, r.PhaseMargin_deg(gains));
  return margins;
}

}  // namespace

TensionLoopMargins CheckTensionLoop(const RobotParameters& robot, const TensionLoopGains& gains,
                                    double period_s) {
  return Margins(RigsOf(robot, period_s), gains);
}

TensionLoopGains DesignTensionLoop(const RobotParameters& robot, double period_s) {
  const Rigs rigs = RigsOf(robot, period_s);
  double softest_Npm = std::numeric_limits<double>::infinity();
  for (const LinearRig& r : rigs.nominal) softest_Npm = std::min(softest_Npm, r.Softest());
  const auto holds = [&](TensionLoopGains& g) {
    if (!Stable(rigs.nominal, g, kLeastGainMargin) || !Stable(rigs.perturbed, g, kLeastPerturbedMargin))
      return false;
    g.margins = Margins(rigs, g);
    return g.margins.stable && g.margins.gain >= kLeastGainMargin &&
           g.margins.phase_deg >= kLeastPhaseMargin_deg;
  };
  // From fast to slow in steps of a fifth; the first with margins is taken. No bisection, because some slow
  // designs fail (too little damping) where faster ones do not.
  for (double bandwidth = 0.3 / period_s; bandwidth > 0.1; bandwidth /= 1.2) {
    TensionLoopGains g = GainsFor(robot, bandwidth, softest_Npm);
    if (holds(g)) return g;
  }
  return GainsFor(robot, 0, softest_Npm);
}

}  // namespace tendril::control
