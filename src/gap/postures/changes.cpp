// Screened by one Gauss-Newton step with the numbers free within their posterior, the best refitted.
#include "changes.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "../rotation.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {
namespace {

// Prior of a change, in plainly visible deviations of the effect; of a number, in the exponent of a factor.
constexpr double kPlausible = 30, kPlausibleFactor = 0.5;
constexpr double kLeastScale = 0.02;
// Weight of the discrepancy found before the change against what the states after it say of its size: it may
// be somewhat larger where the robot is bent otherwise.
constexpr double kSureStates = 20;
constexpr double kNoEvidence = -1e300;

/// An effect that is the same as another frame of the tracker.
void MoveTracker(const Candidate& c, const std::vector<double>& values, PostureRobot& robot) {
  EffectSetting setting{std::string(c.effect->name), c.where, {}};
  for (std::size_t k = 0; k < values.size(); ++k)
    setting.values.emplace_back(c.parameters[k].name, values[k]);
  RobotParameters with = robot.robot;
  with.effects = {setting};
  const sim::TrackerPlacement moved = sim::PlacementOfTracker(with);
  robot.turn_rad = RotationVector(moved.R * Rotation(robot.turn_rad));
  robot.shift_m = moved.R * robot.shift_m + moved.offset_m;
}

/// An effect's parameters at `values`, on a robot whose numbers it changes.
void Apply(const Candidate& c, const Eigen::VectorXd& values, PostureRobot& robot) {
  const std::vector<double> given(values.data(), values.data() + values.size());
  if (c.effect->edit != nullptr) {
    c.effect->edit(robot.robot, c.target, given);
  } else if (c.effect->zero) {
    MoveZero(robot, *c.effect, c.target, given[0]);
  } else {
    MoveTracker(c, given, robot);
  }
}

/// Of a parameter, in prior deviations from no change: masses and lengths of slack are not negative, nor are
/// scales.
double LeastOf(const sim::EffectParameter& p) {
  if (p.nominal == 1) return (kLeastScale - 1) / (kPlausible * ScaleOf(p));
  return p.nominal == 0 && p.lower == 0 ? 0 : -std::numeric_limits<double>::infinity();
}

std::optional<PostureChange> ChangeOf(const Candidate& candidate) {
  const sim::Effect& effect = *candidate.effect;
  const bool shown = effect.edit != nullptr || effect.zero || effect.frame;
  if (!shown) return std::nullopt;
  PostureChange change;
  change.name = candidate.Name();
  change.effect = candidate;
  change.deviation.resize(candidate.size());
  for (int k = 0; k < candidate.size(); ++k)
    change.deviation[k] = kPlausible * ScaleOf(candidate.parameters[static_cast<std::size_t>(k)]);
  change.apply = [candidate](PostureRobot& robot, const Eigen::VectorXd& z) {
    Eigen::VectorXd values(z.size());
    for (int k = 0; k < candidate.size(); ++k) {
      const sim::EffectParameter& p = candidate.parameters[static_cast<std::size_t>(k)];
      values[k] = p.nominal + kPlausible * ScaleOf(p) * std::max(z[k], LeastOf(p));
    }
    Apply(candidate, values, robot);
  };
  return change;
}

PostureChange ChangeOf(const FileNumber& number) {
  PostureChange change;
  change.name = number.key;
  change.number = number;
  change.deviation = Eigen::VectorXd::Constant(1, kPlausibleFactor);
  change.apply = [number](PostureRobot& robot, const Eigen::VectorXd& z) {
    number.apply(robot.robot, kPlausibleFactor * z[0]);
  };
  return change;
}

}  // namespace

double PostureChange::LogOneSided() const {
  double log = 0;
  for (int k = 0; effect && k < size(); ++k) {
    if (LeastOf(effect->parameters[static_cast<std::size_t>(k)]) == 0) log += std::numbers::ln2;
  }
  return log;
}

Eigen::VectorXd PostureChange::Possible(Eigen::VectorXd z) const {
  for (int k = 0; effect && k < size(); ++k)
    z[k] = std::max(z[k], LeastOf(effect->parameters[static_cast<std::size_t>(k)]));
  return z;
}

namespace {

class Searching {
 public:
  Searching(const LearnedPostures& learned, const RobotParameters& file, const Postures& after,
            const ChangeOptions& options)
      : learned_(learned), after_(after), options_(options), measured_(Measured(after)) {
    out_.changes = PostureChanges(file, options.without);
    states_ = static_cast<double>(measured_.rows()) / learned.discrepancy.states_a_bit;
  }

  ChangeSearch Result() {
    const Eigen::VectorXd nothing;
    const Eigen::VectorXd& x = learned_.x;
    Point at = PointAt(nullptr, x, nothing);
    out_.before_m = measured_ - at.predicted.disks_m;
    out_.as_filed_m = measured_ - At(nullptr, Eigen::VectorXd::Zero(x.size()), nothing, 0).disks_m;
    const Normal numbers = NormalAt(at, x, nothing);
    Screen(at, numbers);
    out_.none = Refined(nullptr, x, nothing);
    out_.unlisted_log_evidence = Unlisted(at, numbers);
    std::sort(out_.fits.begin(), out_.fits.end(), Likelier);
    const int refits = std::min(options_.refits, static_cast<int>(out_.fits.size()));
    for (int k = 0; k < refits; ++k) {
      if (options_.progress) options_.progress(0.3 + 0.7 * k / refits);
      Refine(out_.fits[static_cast<std::size_t>(k)]);
    }
    // One step flatters some: whoever is first then is refitted too.
    std::sort(out_.fits.begin(), out_.fits.end(), Likelier);
    while (!out_.fits.empty() && !out_.fits.front().refined) {
      Refine(out_.fits.front());
      std::sort(out_.fits.begin(), out_.fits.end(), Likelier);
    }
    return std::move(out_);
  }

 private:
  struct Point {
    Predicted predicted;
    Eigen::MatrixXd J;         // whitened, of numbers and parameters
    Eigen::VectorXd residual;  // whitened
  };
  struct Normal {
    Eigen::MatrixXd A;
    Eigen::VectorXd b;
  };

  void Refine(ChangeFit& fit) const {
    const int index = fit.change;
    try {
      fit = Refined(&out_.changes[static_cast<std::size_t>(index)], learned_.x, fit.z);
    } catch (const std::exception&) {
      fit = out_.none;  // no robot has that change: it explains no more than none
      fit.z = Eigen::VectorXd::Zero(out_.changes[static_cast<std::size_t>(index)].size());
      fit.covariance = Eigen::MatrixXd::Identity(fit.z.size(), fit.z.size());
      fit.log_evidence = kNoEvidence;
    }
    if (!std::isfinite(fit.log_evidence)) fit.log_evidence = kNoEvidence;
    fit.change = index;
  }

  static bool Likelier(const ChangeFit& a, const ChangeFit& b) { return a.log_evidence > b.log_evidence; }

  Eigen::VectorXd Whitened(const Eigen::MatrixXd& rows) const {
    // State by state, so that quarters are segments.
    return learned_.discrepancy.Whitened(rows).transpose().reshaped();
  }

  Predicted At(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
               Eigen::Index slopes) const {
    const Eigen::Index n = x.size();
    Eigen::VectorXd both(n + z.size());
    both << x, z;
    const auto robot = [&](const Eigen::VectorXd& at) {
      PostureRobot its = learned_.RobotAt(at.head(n));
      if (change != nullptr) change->apply(its, at.tail(at.size() - n));
      return its;
    };
    return Predict(robot, both, static_cast<int>(slopes), after_, options_.threads);
  }

  Point PointAt(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    Point point{At(change, x, z, x.size() + z.size()), {}, {}};
    point.residual = Whitened(measured_ - point.predicted.disks_m);
    point.J.resize(point.residual.size(), static_cast<Eigen::Index>(point.predicted.slopes.size()));
    for (Eigen::Index k = 0; k < point.J.cols(); ++k)
      point.J.col(k) = Whitened(point.predicted.slopes[static_cast<std::size_t>(k)]);
    return point;
  }

  /// Of the log posterior, numbers first.
  Normal NormalAt(const Point& at, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    const Eigen::Index n = x.size(), m = z.size();
    Normal normal{at.J.transpose() * at.J, at.J.transpose() * at.residual};
    normal.A.topLeftCorner(n, n) += learned_.precision;
    normal.b.head(n) -= learned_.precision * (x - learned_.x);
    normal.A.diagonal().tail(m).array() += 1;
    normal.b.tail(m) -= z;
    return normal;
  }

  double Squares(const Eigen::VectorXd& residual, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    const Eigen::VectorXd moved = x - learned_.x;
    return residual.squaredNorm() + moved.dot(learned_.precision * moved) + z.squaredNorm();
  }

  /// The discrepancy's size integrated out: a scaled inverse chi-square prior about that from before.
  double LogEvidence(double squares, double log_occam) const {
    const double freedom = states_ * after_.channels(), sure = kSureStates * after_.channels();
    return -0.5 * (freedom + sure) * std::log((squares + sure) / (freedom + sure)) + log_occam;
  }

  /// Log of the share of z's prior volume that remains, by the numbers' and z's curvature.
  static double LogOccam(const Eigen::MatrixXd& precision_of_z) {
    const Eigen::LLT<Eigen::MatrixXd> factor(precision_of_z);
    return -factor.matrixLLT().diagonal().array().log().sum();
  }

  /// Every change by one step from none, with the numbers following.
  void Screen(const Point& at, const Normal& numbers) {
    const Eigen::LDLT<Eigen::MatrixXd> solved(numbers.A);
    const Eigen::VectorXd x_step = solved.solve(numbers.b);
    const double squares0 = at.residual.squaredNorm() - numbers.b.dot(x_step);
    const auto count = static_cast<double>(out_.changes.size());
    std::vector<Eigen::VectorXd> effects;  // what each changes, of those with one parameter
    for (std::size_t c = 0; c < out_.changes.size(); ++c) {
      if (options_.progress) options_.progress(0.3 * static_cast<double>(c) / count);
      const PostureChange& change = out_.changes[c];
      try {
        const Eigen::MatrixXd Jz = SlopesOf(change);
        if (Jz.cwiseAbs().maxCoeff() == 0) continue;  // these states do not show it
        if (change.number && IsOneOf(effects, Jz.col(0))) continue;
        if (change.effect && Jz.cols() == 1) effects.push_back(Jz.col(0));
        Eigen::MatrixXd A = Jz.transpose() * Jz;
        A.diagonal().array() += 1;
        const Eigen::MatrixXd mixed = at.J.transpose() * Jz;
        A -= mixed.transpose() * solved.solve(mixed);
        const Eigen::VectorXd b = Jz.transpose() * at.residual - mixed.transpose() * x_step;
        ChangeFit fit;
        fit.change = static_cast<int>(c);
        fit.z = change.Possible(A.ldlt().solve(b));
        fit.covariance = A.inverse();
        fit.squares = squares0 - 2 * b.dot(fit.z) + fit.z.dot(A * fit.z);
        fit.log_evidence = LogEvidence(fit.squares, LogOccam(A) + change.LogOneSided());
        if (std::isfinite(fit.log_evidence)) out_.fits.push_back(std::move(fit));
      } catch (const std::exception&) {
        // no robot: it explains nothing
      }
    }
  }

  /// A number that does what an effect does is that effect: the core's radius is the bending stiffness.
  static bool IsOneOf(const std::vector<Eigen::VectorXd>& effects, const Eigen::VectorXd& slope) {
    constexpr double kSameCosine = 0.999;
    return std::any_of(effects.begin(), effects.end(), [&](const Eigen::VectorXd& effect) {
      return std::abs(effect.dot(slope)) > kSameCosine * effect.norm() * slope.norm();
    });
  }

  Eigen::MatrixXd SlopesOf(const PostureChange& change) const {
    const Eigen::VectorXd none = Eigen::VectorXd::Zero(change.size());
    const auto robot = [&](const Eigen::VectorXd& z) {
      PostureRobot its = learned_.RobotAt(learned_.x);
      change.apply(its, z);
      return its;
    };
    const Predicted slopes = Predict(robot, none, change.size(), after_, options_.threads);
    Eigen::MatrixXd J(measured_.size(), change.size());
    for (int k = 0; k < change.size(); ++k) J.col(k) = Whitened(slopes.slopes[static_cast<std::size_t>(k)]);
    return J;
  }

  /// Numbers and parameters at their joint maximum. The numbers' slopes hold for a few steps: most of the
  /// time goes into them.
  ChangeFit Refined(const PostureChange* change, Eigen::VectorXd x, Eigen::VectorXd z) const {
    constexpr int kRounds = 6, kSteps = 5;
    constexpr double kNearly = 0.02;
    z *= 0.5;  // the step from no change often goes too far
    Point at = PointAt(change, x, z);
    double squares = Squares(at.residual, x, z);
    for (int round = 0; round < kRounds; ++round) {
      const double before = squares;
      for (int step = 0; step < kSteps; ++step) {
        const double gained = StepFrom(change, at, x, z, squares);
        if (gained < kNearly) break;
        UpdateParameters(change, x, z, at);
      }
      at = PointAt(change, x, z);
      if (before - squares < kNearly) break;
    }
    return Summarised(change, at, x, z, squares);
  }

  /// Infinite where there is no such robot.
  double SquaresAt(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z) const {
    try {
      return Squares(Whitened(measured_ - At(change, x, z, 0).disks_m), x, z);
    } catch (const std::invalid_argument&) {
      return std::numeric_limits<double>::infinity();
    }
  }

  /// Moves to the first shorter and shorter step that is better; by how much.
  double StepFrom(const PostureChange* change, const Point& at, Eigen::VectorXd& x, Eigen::VectorXd& z,
                  double& squares) const {
    const Normal normal = NormalAt(at, x, z);
    const Eigen::VectorXd way = normal.A.ldlt().solve(normal.b);
    for (double share = 1; share > 0.02; share /= 3) {
      const Eigen::VectorXd x1 = x + share * way.head(x.size()), z1 = z + share * way.tail(z.size());
      const double there = SquaresAt(change, x1, z1);
      if (!(there < squares)) continue;
      const double gained = squares - there;
      x = x1;
      z = change != nullptr ? change->Possible(z1) : z1;
      squares = there;
      return gained;
    }
    return 0;
  }

  /// The prediction and the slopes of the change's own parameters at (x, z); those of the numbers stay.
  void UpdateParameters(const PostureChange* change, const Eigen::VectorXd& x, const Eigen::VectorXd& z,
                        Point& at) const {
    const Eigen::Index m = z.size();
    const auto robot = [&](const Eigen::VectorXd& of) {
      PostureRobot its = learned_.RobotAt(x);
      if (change != nullptr) change->apply(its, of);
      return its;
    };
    const Predicted here = Predict(robot, z, static_cast<int>(m), after_, options_.threads);
    at.residual = Whitened(measured_ - here.disks_m);
    for (Eigen::Index k = 0; k < m; ++k)
      at.J.col(x.size() + k) = Whitened(here.slopes[static_cast<std::size_t>(k)]);
  }

  ChangeFit Summarised(const PostureChange* change, const Point& at, const Eigen::VectorXd& x,
                       const Eigen::VectorXd& z, double squares) const {
    const Eigen::Index m = z.size();
    ChangeFit fit;
    fit.x = x;
    fit.z = z;
    fit.squares = squares;
    fit.refined = true;
    fit.left_m = measured_ - at.predicted.disks_m;
    const Normal normal = NormalAt(at, x, z);
    double log_occam = 0;
    if (m > 0) {
      const Eigen::MatrixXd inverse = normal.A.inverse();
      const double sure = kSureStates * after_.channels();
      const double scale = (squares + sure) / (states_ * after_.channels() + sure);
      fit.covariance = std::max(1.0, scale) * inverse.bottomRightCorner(m, m);
      log_occam = LogOccam(inverse.bottomRightCorner(m, m).inverse()) + change->LogOneSided();
    }
    fit.log_evidence = LogEvidence(squares, log_occam);
    if (change != nullptr) fit.sigma = Sigma(at.predicted.disks_m - At(nullptr, x, {}, 0).disks_m);
    HoldOut(at, normal, fit);
    return fit;
  }

  double Sigma(const Eigen::MatrixXd& moved) const {
    double most = 0;
    for (Eigen::Index d = 0; d < moved.cols(); d += 3) {
      const double rms = std::sqrt(moved.middleCols(d, 3).squaredNorm() / static_cast<double>(moved.rows()));
      const Eigen::MatrixXd& held = learned_.held_out_m;
      const double floor = std::sqrt(held.middleCols(d, 3).squaredNorm() / static_cast<double>(held.rows()));
      most = std::max(most, rms / floor);
    }
    return most;
  }

  /// Each quarter with the numbers and parameters that the others give, one step from the common maximum.
  void HoldOut(const Point& at, const Normal& normal, ChangeFit& fit) const {
    fit.held_out_m = fit.left_m;
    const Eigen::Index states = measured_.rows(), channels = measured_.cols();
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      const Eigen::Index first = states * quarter / kQuarters;
      const Eigen::Index count = states * (quarter + 1) / kQuarters - first;
      const auto J = at.J.middleRows(first * channels, count * channels);
      const auto r = at.residual.segment(first * channels, count * channels);
      const Eigen::VectorXd moved = (normal.A - J.transpose() * J).ldlt().solve(normal.b - J.transpose() * r);
      for (Eigen::Index k = 0; k < moved.size(); ++k) {
        fit.held_out_m.middleRows(first, count) -=
            moved[k] * at.predicted.slopes[static_cast<std::size_t>(k)].middleRows(first, count);
      }
    }
  }

  /// Evidence of a change that is no hypothesis of the library: each whitened channel shifted by a function
  /// of the motors' angles of second order, whose size the data choose; the numbers are free as beside any
  /// other.
  double Unlisted(const Point& at, const Normal& numbers) const {
    const Eigen::MatrixXd basis = Basis();
    const Eigen::Index n = at.J.cols(), channels = measured_.cols(), functions = basis.cols() * channels;
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(at.J.rows(), n + functions);
    J.leftCols(n) = at.J;
    for (Eigen::Index state = 0; state < basis.rows(); ++state) {
      for (Eigen::Index c = 0; c < channels; ++c)
        J.row(state * channels + c).segment(n + c * basis.cols(), basis.cols()) = basis.row(state);
    }
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n + functions, n + functions);
    information.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
    information.topLeftCorner(n, n) = numbers.A;
    const Eigen::VectorXd pull = J.transpose() * at.residual;
    const double of_numbers = LogDeterminant(numbers.A);
    double best = kNoEvidence;
    for (double variance = 1e-4; variance < 1e6; variance *= 10) {
      Eigen::MatrixXd A = information;
      A.diagonal().tail(functions).array() += 1 / variance;
      const Eigen::LDLT<Eigen::MatrixXd> solved(A.selfadjointView<Eigen::Lower>());
      const double squares = at.residual.squaredNorm() - pull.dot(solved.solve(pull));
      const double volume = static_cast<double>(functions) * std::log(variance);
      const double occam = 0.5 * (of_numbers - solved.vectorD().array().log().sum() - volume);
      best = std::max(best, LogEvidence(squares, occam));
    }
    return best;
  }

  static double LogDeterminant(const Eigen::MatrixXd& of) {
    return Eigen::LDLT<Eigen::MatrixXd>(of).vectorD().array().log().sum();
  }

  /// S x functions: constant, angles of unit rms, and their products.
  Eigen::MatrixXd Basis() const {
    Eigen::MatrixXd angles(measured_.rows(), after_.runs.front().motor_rad.cols());
    Eigen::Index row = 0;
    for (const States& run : after_.runs) {
      angles.middleRows(row, run.motor_rad.rows()) = run.motor_rad;
      row += run.motor_rad.rows();
    }
    // Motors that turn together are one.
    const Eigen::MatrixXd centred = angles.rowwise() - angles.colwise().mean();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(centred, Eigen::ComputeThinU);
    const Eigen::Index rank = (svd.singularValues().array() > 1e-3 * svd.singularValues()[0]).count();
    const Eigen::MatrixXd free = std::sqrt(static_cast<double>(angles.rows())) * svd.matrixU().leftCols(rank);
    Eigen::MatrixXd basis(angles.rows(), 1 + rank + rank * (rank + 1) / 2);
    basis.col(0).setOnes();
    basis.middleCols(1, rank) = free;
    Eigen::Index column = 1 + rank;
    for (Eigen::Index a = 0; a < rank; ++a) {
      for (Eigen::Index b = a; b < rank; ++b) basis.col(column++) = free.col(a).cwiseProduct(free.col(b));
    }
    return basis;
  }

  const LearnedPostures& learned_;
  const Postures& after_;
  const ChangeOptions& options_;
  const Eigen::MatrixXd measured_;
  double states_ = 0;  // independent ones
  ChangeSearch out_;
};

}  // namespace

std::vector<PostureChange> PostureChanges(const RobotParameters& robot,
                                          const std::vector<std::string>& without) {
  std::vector<PostureChange> changes;
  for (const Candidate& candidate : AllCandidates(robot, false, true)) {
    if (std::find(without.begin(), without.end(), candidate.effect->name) != without.end()) continue;
    if (auto change = ChangeOf(candidate)) changes.push_back(std::move(*change));
  }
  for (const FileNumber& number : FileNumbers(robot)) {
    if (number.effect.empty() && number.tendon == 0) changes.push_back(ChangeOf(number));
  }
  return changes;
}

ChangeSearch SearchChange(const LearnedPostures& learned, const RobotParameters& file, const Postures& after,
                          const ChangeOptions& options) {
  return Searching(learned, file, after, options).Result();
}

}  // namespace tendril::gap
