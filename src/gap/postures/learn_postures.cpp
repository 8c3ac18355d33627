// Levenberg-Marquardt steps, the discrepancy of each channel estimated with the numbers.
#include "learn_postures.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tendril::gap {
namespace {

constexpr double kBegin = 0.05;     // error that the file's model is taken to have, of the length
constexpr double kFinest_m = 1e-4;  // no tracker of a whole robot is better
constexpr int kSettles = 4;         // steps before the discrepancy follows the fit
constexpr int kMostSteps = 40;
constexpr double kStill = 0.05;  // gain of log posterior below which the numbers have settled
constexpr double kUsualBit = 5;  // states that count as one until that is known

/// States that count as one by how the means of blocks scatter, which independent ones would do less.
double StatesABit(const Eigen::MatrixXd& left) {
  const double each = left.squaredNorm() / static_cast<double>(left.rows());
  double most = 1;
  for (Eigen::Index length = 2; 6 * length <= left.rows(); length *= 2) {
    double of_means = 0;
    const Eigen::Index blocks = left.rows() / length;
    for (Eigen::Index b = 0; b < blocks; ++b)
      of_means += left.middleRows(b * length, length).colwise().mean().squaredNorm();
    most = std::max(most, static_cast<double>(length) * of_means / static_cast<double>(blocks) / each);
  }
  return most;
}

class Learning {
 public:
  Learning(const RobotParameters& file, const Postures& postures, bool frame_is_known,
           const LearnPosturesOptions& options)
      : postures_(postures), options_(options), measured_(Measured(postures)) {
    out_.file = PostureRobot::Of(file);
    out_.numbers = PostureNumbers(file, frame_is_known);
    const auto n = static_cast<Eigen::Index>(out_.numbers.size());
    out_.x = Eigen::VectorXd::Zero(n);
    prior_.resize(n);
    for (Eigen::Index p = 0; p < n; ++p)
      prior_[p] = 1 / std::pow(out_.numbers[static_cast<std::size_t>(p)].deviation, 2);
    variance_.setConstant(postures.channels(), std::pow(kBegin * file.body.length_m(), 2));
    weight_.setOnes(measured_.rows());
  }

  LearnedPostures Result() {
    if (measured_.rows() < kLeastPostures) {
      throw std::runtime_error(
          fmt::format("{} states; accepted: at least {}, for the numbers of a robot to be told from them",
                      measured_.rows(), kLeastPostures));
    }
    now_ = At(out_.x);
    out_.as_filed_m = measured_ - now_.disks_m;
    Settle(kMostSteps, true);
    out_.left_m = measured_ - now_.disks_m;
    out_.unsolved = now_.unsolved;
    HoldOut();
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

  double Cost(const Eigen::MatrixXd& predicted, const Eigen::VectorXd& x) const {
    const Eigen::ArrayXd squares = (measured_ - predicted)
                                       .array()
                                       .square()
                                       .rowwise()
                                       .
                                       operator/(variance_.transpose().array())
                                       .rowwise()
                                       .sum();
    return 0.5 * (squares * weight_.array()).sum() / bit_ + 0.5 * prior_.dot(x.cwiseAbs2());
  }

  Normal NormalAt(const Predicted& at, const Eigen::VectorXd& x) const {
    Normal normal{prior_.asDiagonal(), -prior_.cwiseProduct(x)};
    const Eigen::MatrixXd left = measured_ - at.disks_m;
    const auto n = static_cast<Eigen::Index>(at.slopes.size());
    Eigen::MatrixXd J(left.rows(), n);
    for (Eigen::Index c = 0; c < left.cols(); ++c) {
      for (Eigen::Index p = 0; p < n; ++p) J.col(p) = at.slopes[static_cast<std::size_t>(p)].col(c);
      const Eigen::MatrixXd weighted = weight_.asDiagonal() * J;
      const double w = 1 / (variance_[c] * bit_);
      normal.A.noalias() += w * J.transpose() * weighted;
      normal.b.noalias() += w * weighted.transpose() * left.col(c);
    }
    return normal;
  }

  /// Towards the maximum, in so many steps; `follow`: with the discrepancy of each channel.
  void Settle(int most, bool follow) {
    double damping = follow ? 1e-2 : 1e-6;
    for (int step = 0; step < most; ++step) {
      if (options_.progress && follow) options_.progress(0.7 * step / kMostSteps);
      if (follow && step >= kSettles) FollowDiscrepancy();
      const double cost = Cost(now_.disks_m, out_.x);
      const double gain = cost - StepFrom(cost, damping);
      ++out_.iterations;
      if (gain < kStill && step > kSettles) {
        out_.converged = true;
        return;
      }
    }
  }

  void FollowDiscrepancy() {
    const Eigen::MatrixXd left = measured_ - now_.disks_m;
    variance_ = left.colwise().squaredNorm().transpose() / static_cast<double>(left.rows());
    variance_ = variance_.cwiseMax(kFinest_m * kFinest_m);
  }

  /// The cost there; `cost` where no step brings anything.
  double StepFrom(double cost, double& damping) {
    const Normal normal = NormalAt(now_, out_.x);
    for (int attempt = 0; attempt < 7; ++attempt) {
      Eigen::MatrixXd damped = normal.A;
      damped.diagonal() *= 1 + damping;
      const Eigen::VectorXd x = out_.x + damped.ldlt().solve(normal.b);
      try {
        const double there = Cost(At(x, false).disks_m, x);
        if (there < cost) {
          now_ = At(x);
          out_.x = x;
          damping = std::max(1e-7, damping / 4);
          return there;
        }
      } catch (const std::invalid_argument&) {
        // no robot: the step is too long
      }
      damping *= 6;
    }
    return cost;
  }

  void HoldOut() {
    const Eigen::VectorXd x = out_.x;
    const Predicted at_all = now_;
    out_.held_out_m = out_.left_m;
    const Eigen::Index states = measured_.rows();
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      if (options_.progress) options_.progress(0.7 + 0.3 * quarter / kQuarters);
      const Eigen::Index first = states * quarter / kQuarters;
      const Eigen::Index count = states * (quarter + 1) / kQuarters - first;
      weight_.setOnes();
      weight_.segment(first, count).setZero();
      Settle(kSettles, false);
      out_.held_out_m.middleRows(first, count) = (measured_ - now_.disks_m).middleRows(first, count);
      out_.x = x;
      now_ = at_all;
    }
    weight_.setOnes();
    Discrepancy& d = out_.discrepancy;
    d.covariance = out_.held_out_m.transpose() * out_.held_out_m / static_cast<double>(states);
    d.covariance.diagonal().array() += kFinest_m * kFinest_m;
    d.states_a_bit = StatesABit(d.Whitened(out_.held_out_m));
    out_.precision = prior_.asDiagonal();
    Eigen::MatrixXd J(states * measured_.cols(), x.size());
    for (Eigen::Index p = 0; p < x.size(); ++p)
      J.col(p) = d.Whitened(now_.slopes[static_cast<std::size_t>(p)]).transpose().reshaped();
    const Eigen::MatrixXd information = J.transpose() * J;
    out_.precision += information;
    TakeDisagreement(J, information);
  }

  /// The quarters' pulls on the numbers, over what independent errors would pull: where they disagree by
  /// more, the states say less than their number does (a sandwich estimate of the information).
  void TakeDisagreement(const Eigen::MatrixXd& J, const Eigen::MatrixXd& information) {
    const Eigen::VectorXd left = out_.discrepancy.Whitened(out_.held_out_m).transpose().reshaped();
    const Eigen::LDLT<Eigen::MatrixXd> posterior(out_.precision);
    double pulls = 0;
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      const Eigen::Index states = measured_.rows(), channels = measured_.cols();
      const Eigen::Index first = states * quarter / kQuarters;
      const Eigen::Index rows = (states * (quarter + 1) / kQuarters - first) * channels;
      const Eigen::VectorXd pull =
          J.middleRows(first * channels, rows).transpose() * left.segment(first * channels, rows);
      pulls += pull.dot(posterior.solve(pull));
    }
    // Numbers from the other quarters are themselves uncertain.
    constexpr double kExpected = kQuarters / (kQuarters - 1.0);
    const double disagreement = std::max(1.0, pulls / (kExpected * posterior.solve(information).trace()));
    out_.discrepancy.states_a_bit *= disagreement;
    out_.precision = information / disagreement;
    out_.precision.diagonal() += prior_;
  }

  const Postures& postures_;
  const LearnPosturesOptions& options_;
  const Eigen::MatrixXd measured_;
  Eigen::VectorXd prior_, variance_, weight_;
  double bit_ = kUsualBit;
  Predicted now_;  // at out_.x
  LearnedPostures out_;
};

}  // namespace

Eigen::MatrixXd Discrepancy::Whitened(const Eigen::MatrixXd& rows) const {
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  return factor.matrixL().solve(rows.transpose()).transpose() / std::sqrt(states_a_bit);
}

LearnedPostures LearnPostures(const RobotParameters& file, const Postures& postures, bool frame_is_known,
                              const LearnPosturesOptions& options) {
  return Learning(file, postures, frame_is_known, options).Result();
}

}  // namespace tendril::gap
