// Levenberg-Marquardt steps, the discrepancy of each channel estimated with the numbers.
#include "learn_postures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace tendril::gap {
namespace {

constexpr double kBegin = 0.05;      // error that the file's model is taken to have, of the length
constexpr double kFinest_m = 1e-4;   // no tracker of a whole robot is better
constexpr int kBeforeFollowing = 4;  // steps before the discrepancy follows the fit
constexpr int kMostSteps = 40;
constexpr int kHeldOutSteps = 8;     // without a quarter, from where all are
constexpr double kStill = 0.05;      // log posterior that a Newton step promises at a maximum
constexpr double kUsualStates = 5;   // states per independent one until that is estimated
constexpr double kUsualSteps = 120;  // of a whole fit, for the progress

/// From how the means of blocks scatter, compared with those of independent states; both by the product of
/// held-out and fitted residuals, see ErrorCovariance. A row a state.
double StatesPerIndependent(const Eigen::MatrixXd& held_out, const Eigen::MatrixXd& fitted) {
  const double each = held_out.cwiseProduct(fitted).sum() / static_cast<double>(fitted.rows());
  double most = 1;
  for (Eigen::Index length = 2; 6 * length <= fitted.rows(); length *= 2) {
    double of_means = 0;
    const Eigen::Index blocks = fitted.rows() / length;
    for (Eigen::Index b = 0; b < blocks; ++b) {
      const auto mean = [&](const Eigen::MatrixXd& of) {
        return of.middleRows(b * length, length).colwise().mean().eval();
      };
      of_means += mean(held_out).dot(mean(fitted));
    }
    most = std::max(most, static_cast<double>(length) * of_means / static_cast<double>(blocks) / each);
  }
  return most;
}

class Learning {
 public:
  Learning(const RobotParameters& file, const Postures& postures, bool frame_is_known,
           const LearnPosturesOptions& options)
      : postures_(postures), options_(options), measured_(postures.Stacked(&States::seen_m)) {
    out_.file = PostureRobot::Of(WithSheaths(file));
    out_.numbers = PostureNumbers(file, frame_is_known, postures.points);
    const auto n = static_cast<Eigen::Index>(out_.numbers.size());
    out_.x = Eigen::VectorXd::Zero(n);
    prior_.resize(n);
    for (Eigen::Index p = 0; p < n; ++p)
      prior_[p] = 1 / std::pow(out_.numbers[static_cast<std::size_t>(p)].deviation, 2);
    noise_.covariance = std::pow(kBegin * file.body.length_m(), 2) *
                        Eigen::MatrixXd::Identity(postures.channels(), postures.channels());
    noise_.states_per_independent = kUsualStates;
  }

  LearnedPostures Result() {
    if (measured_.rows() < kLeastPostures) {
      throw std::runtime_error(fmt::format(
          "{} states, too few to infer the numbers of a robot; accepted: at least {}; record longer "
          "runs",
          measured_.rows(), kLeastPostures));
    }
    const Eigen::MatrixXd moved = postures_.Moved();
    out_.motion_m.resize(measured_.cols() / 3);
    for (Eigen::Index p = 0; p < out_.motion_m.size(); ++p)
      out_.motion_m[p] = PointRms(moved, static_cast<int>(p));
    now_ = At(out_.x);
    out_.as_filed_m = measured_ - now_.channels_m;
    Settle(kMostSteps, true);
    // The first discrepancy is that of numbers weighted channel by channel, the second of those reported.
    for (int round = 0; round < 2; ++round) {
      HoldOut();
      TakeDisagreement();
      noise_ = out_.discrepancy;
      out_.converged = Settle(kMostSteps, false);
    }
    out_.prior = prior_;
    out_.precision = NormalAt(now_, out_.x).A;
    out_.unsolved = now_.unsolved;
    out_.steps = steps_;
    return std::move(out_);
  }

 private:
  struct Normal {
    Eigen::MatrixXd A;
    Eigen::VectorXd b;
  };

  Predicted At(const Eigen::VectorXd& x, bool slopes = true) const {
    return Predict([&](const Eigen::VectorXd& at) { return out_.RobotAt(at); }, x,
                   slopes ? static_cast<int>(x.size()) : 0, postures_, options_.threads);
  }

  /// Whitened, those of the quarter held out taken as 0.
  Eigen::VectorXd Residual(const Eigen::MatrixXd& predicted) const {
    Eigen::VectorXd residual = noise_.Whitened(measured_ - predicted);
    residual.segment(without_.first * measured_.cols(), without_.count * measured_.cols()).setZero();
    return residual;
  }

  double Cost(const Eigen::MatrixXd& predicted, const Eigen::VectorXd& x) const {
    return 0.5 * (Residual(predicted).squaredNorm() + prior_.dot(x.cwiseAbs2()));
  }

  Normal NormalAt(const Predicted& at, const Eigen::VectorXd& x) const {
    Eigen::MatrixXd J = noise_.Whitened(at.slopes);
    J.middleRows(without_.first * measured_.cols(), without_.count * measured_.cols()).setZero();
    Normal normal{J.transpose() * J, J.transpose() * Residual(at.channels_m) - prior_.cwiseProduct(x)};
    normal.A.diagonal() += prior_;
    return normal;
  }

  /// Towards the maximum; `follow`: weighted by what it leaves of each channel. True where it arrives.
  bool Settle(int most, bool follow) {
    double damping = follow ? 1e-2 : 1e-6;
    for (int step = 0; step < most; ++step) {
      ++steps_;
      if (options_.progress) options_.progress(std::min(1.0, steps_ / kUsualSteps));
      const bool following = follow && step >= kBeforeFollowing;
      if (following) FollowDiscrepancy();
      const Normal normal = NormalAt(now_, out_.x);
      const double promised = 0.5 * normal.b.dot(normal.A.ldlt().solve(normal.b));
      if (promised < kStill && following == follow) return true;
      if (!StepFrom(normal, damping)) return false;
    }
    return false;
  }

  void FollowDiscrepancy() {
    const Eigen::MatrixXd left = measured_ - now_.channels_m;
    const Eigen::VectorXd variance =
        left.colwise().squaredNorm().transpose() / static_cast<double>(left.rows());
    noise_.covariance = variance.cwiseMax(kFinest_m * kFinest_m).asDiagonal();
  }

  /// Moves to the first shorter and shorter step that is better; false where none is. The damping falls where
  /// a step gained what it promised, and rises where it gained little of it.
  bool StepFrom(const Normal& normal, double& damping) {
    constexpr int kAttempts = 10;
    constexpr double kLess = 4, kMore = 6, kLeast = 1e-7;  // damping after a good step and a bad one
    constexpr double kKept = 0.75, kBroken = 0.25;
    const double cost = Cost(now_.channels_m, out_.x);
    for (int attempt = 0; attempt < kAttempts; ++attempt, damping = std::max(kLeast, damping) * kMore) {
      Eigen::MatrixXd damped = normal.A;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd way = damped.ldlt().solve(normal.b), x = out_.x + way;
      const double promised = way.dot(normal.b) - 0.5 * way.dot(normal.A * way);
      try {
        const double gained = cost - Cost(At(x, false).channels_m, x);
        if (!(gained > 0)) continue;
        now_ = At(x);
        out_.x = x;
        if (gained > kKept * promised) damping = std::max(kLeast, damping / kLess);
        if (gained < kBroken * promised) damping = std::max(kLeast, damping) * kMore;
        return true;
      } catch (const std::invalid_argument&) {
        // no such robot: the step is too long
      }
    }
    return false;
  }

  void HoldOut() {
    const Eigen::VectorXd x = out_.x;
    const Predicted at_all = now_;
    fitted_m_ = measured_ - now_.channels_m;
    out_.held_out_m = fitted_m_;
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      without_ = QuarterOf(quarter, measured_.rows());
      Settle(kHeldOutSteps, false);
      out_.held_out_m.middleRows(without_.first, without_.count) =
          (measured_ - now_.channels_m).middleRows(without_.first, without_.count);
      without_ = {};
      out_.x = x;
      now_ = at_all;
    }
    Discrepancy& d = out_.discrepancy;
    d.covariance = ErrorCovariance();
    const auto by_state = [&](const Eigen::MatrixXd& residuals) {
      return d.Whitened(residuals).reshaped(measured_.cols(), measured_.rows()).transpose().eval();
    };
    d.states_per_independent = StatesPerIndependent(by_state(out_.held_out_m), by_state(fitted_m_));
  }

  /// Held out, residuals have the error of the numbers added; fitted, they have lost as much of their own:
  /// e_out = (I - H)^-1 e_in with H of the quarter, so that the geometric mean of the two is about that
  /// of the error.
  Eigen::MatrixXd ErrorCovariance() const {
    const auto covariance = [](const Eigen::MatrixXd& of) {
      Eigen::MatrixXd its = of.transpose() * of / static_cast<double>(of.rows());
      its.diagonal().array() += kFinest_m * kFinest_m;
      return its;
    };
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> fitted(covariance(fitted_m_));
    const Eigen::MatrixXd root = fitted.operatorSqrt(), inverse = fitted.operatorInverseSqrt();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ratio(inverse * covariance(out_.held_out_m) *
                                                               inverse);
    return root * ratio.operatorSqrt() * root;
  }

  /// Where the quarters' scores disagree by more than independent errors would, the states say less than
  /// their number does: a sandwich estimate of the information.
  void TakeDisagreement() {
    Discrepancy& d = out_.discrepancy;
    const Eigen::MatrixXd J = d.Whitened(now_.slopes);
    const Eigen::VectorXd fitted = d.Whitened(fitted_m_), held_out = d.Whitened(out_.held_out_m);
    const Eigen::MatrixXd information = J.transpose() * J;
    Eigen::MatrixXd precision = information;
    precision.diagonal() += prior_;
    const Eigen::LDLT<Eigen::MatrixXd> posterior(precision);
    double scores = 0;
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      const auto [first, count] = QuarterOf(quarter, measured_.rows());
      const Eigen::Index channels = measured_.cols();
      const auto its = J.middleRows(first * channels, count * channels).transpose();
      const Eigen::VectorXd score = its * held_out.segment(first * channels, count * channels);
      scores += score.dot(posterior.solve(its * fitted.segment(first * channels, count * channels)));
    }
    d.states_per_independent *= std::max(1.0, scores / posterior.solve(information).trace());
  }

  const Postures& postures_;
  const LearnPosturesOptions& options_;
  const Eigen::MatrixXd measured_;
  Eigen::VectorXd prior_;     // precision of each number
  Discrepancy noise_;         // that the fit is weighted by
  StateRange without_;        // states held out
  Eigen::MatrixXd fitted_m_;  // residuals of all states with the numbers that all give
  int steps_ = 0;
  Predicted now_;  // at out_.x
  LearnedPostures out_;
};

}  // namespace

std::optional<int> PostureStates(const DataSet& set) {
  if (!ShowsPostures(set)) return std::nullopt;
  std::vector<const Run*> runs;
  for (const Run& run : set.runs) runs.push_back(&run);
  return PosturesOf(runs, set.robot).states();
}

bool EnoughPostures(const std::vector<const Run*>& runs, const RobotParameters& robot) {
  if (runs.empty()) return false;
  try {
    return PosturesOf(runs, robot).states() >= kLeastPostures;
  } catch (const std::runtime_error&) {
    return false;  // no common markers, or nothing read together
  }
}

StateRange QuarterOf(int quarter, Eigen::Index states) {
  const Eigen::Index first = states * quarter / kQuarters;
  return {first, states * (quarter + 1) / kQuarters - first};
}

Eigen::VectorXd Discrepancy::Whitened(const Eigen::MatrixXd& residuals) const {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  const Eigen::MatrixXd by_state = factor.matrixL().solve(residuals.transpose());
  return by_state.reshaped() / std::sqrt(states_per_independent);
}

Eigen::MatrixXd Discrepancy::Whitened(const std::vector<Eigen::MatrixXd>& slopes) const {
  Eigen::MatrixXd all(slopes.empty() ? 0 : slopes.front().size(), static_cast<Eigen::Index>(slopes.size()));
  for (std::size_t k = 0; k < slopes.size(); ++k) all.col(static_cast<Eigen::Index>(k)) = Whitened(slopes[k]);
  return all;
}

double LearnedPostures::Floor(int point) const { return PointRms(held_out_m, point); }

double PointRms(const Eigen::MatrixXd& residuals_m, int point) {
  return std::sqrt(residuals_m.middleCols(3 * point, 3).squaredNorm() /
                   static_cast<double>(residuals_m.rows()));
}

double ChannelRms(const Eigen::MatrixXd& residuals_m, Eigen::Index channel) {
  return std::sqrt(residuals_m.col(channel).squaredNorm() / static_cast<double>(residuals_m.rows()));
}

bool LearnedPostures::Predicts() const {
  constexpr double kMostMissed = 0.5;  // of the motion: a quarter of its variance
  for (int p = 0; p < motion_m.size(); ++p) {
    if (Floor(p) < kMostMissed * Motion(p)) return true;
  }
  return false;
}

std::string PointsText(const Postures& postures, const std::function<double(int point)>& value_m) {
  std::string places, turns;
  for (int p = 0; p < static_cast<int>(postures.points.size()); ++p) {
    const bool turn = postures.IsTurn(3 * p);
    std::string& text = turn ? turns : places;
    const double value = value_m(p) / postures.PerUnit(3 * p);
    text += fmt::format("{}{:.1f}", text.empty() ? "" : " / ",
                        turn ? value * 180 / std::numbers::pi : 1e3 * value);
  }
  if (!places.empty()) places += " mm";
  if (!turns.empty()) turns += " deg";
  return places + (places.empty() || turns.empty() ? "" : " and ") + turns;
}

std::string NotLearnedText(const LearnedPostures& learned, const Postures& postures, const char* runs) {
  return fmt::format(
      "The robot cannot be learned from {}: it misses its disks by {} in states that it was not fitted to, "
      "where they move by {}. Check lengths, holes, directions of motors and the frame in robot file and "
      "map, and give each disk more units. ",
      runs, PointsText(postures, [&](int p) { return learned.Floor(p); }),
      PointsText(postures, [&](int p) { return learned.Motion(p); }));
}

std::string ClockDriftText(const LearnedPostures& learned) {
  constexpr double kDeviations = 3;
  const auto drift = std::find_if(learned.numbers.begin(), learned.numbers.end(),
                                  [](const PostureNumber& n) { return n.key == kClockDrift; });
  if (drift == learned.numbers.end()) return "";
  const auto i = drift - learned.numbers.begin();
  const double value = drift->per_change * learned.x[i];
  const double deviation =
      drift->per_change *
      std::sqrt(learned.precision.ldlt().solve(Eigen::VectorXd::Unit(learned.x.size(), i))[i]);
  if (std::abs(value) < kDeviations * deviation) return "";
  return fmt::format(
      "the tracker's clock {} {:.2g} ms a second against the motors' (standard deviation {:.1g}): taken out",
      value > 0 ? "gains" : "loses", 1e3 * std::abs(value), 1e3 * deviation);
}

LearnedPostures LearnPostures(const RobotParameters& file, const Postures& postures, bool frame_is_known,
                              const LearnPosturesOptions& options) {
  return Learning(file, postures, frame_is_known, options).Result();
}

}  // namespace tendril::gap
