// Tendon tensions for a required force on the sections: the least-norm admissible solution, by its dual.
// Knows a matrix, a force and bounds; of the robot only how its tendons act on a section's arc motion.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "tendril/model/inverse.h"

namespace tendril::model {
namespace {

constexpr int kMaxForces = 2 * kMaxSections;
// Pull that is left to a pair whose tendons are at their bounds, so that its range is one.
constexpr double kLeastPull_N = 1e-9;
using ForceVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxForces, 1>;
using ForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxForces, kMaxForces>;
using ForceTensionMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxForces, kMaxTendons>;

using TensionForceMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxTendons, kMaxForces>;

/// Whether each force component can be produced nearly independently of the others.
bool WellConditioned(const ForceTensionMatrix& a) {
  const Eigen::LLT<ForceMatrix> factor(a * a.transpose());
  return factor.info() == Eigen::Success && factor.rcond() > 1e-4;
}

enum class Bound : signed char { kLower, kFree, kUpper };
using BoundSet = std::array<Bound, kMaxTendons>;

/// min |x|^2 / 2 with A x = b, lower <= x <= upper, lower <= 0 <= upper, columns of A at most 1 long. Its
/// dual is
///   x(y) = clip(A^T y, lower, upper),  A x(y) + regularisation y = b,
/// the gradient of a convex, piecewise quadratic function of y. The small regularisation keeps y finite when
/// b is out of reach; x(y) then tends to the admissible x nearest to b and, among those, to the one of least
/// norm.
class BoundedLeastNorm {
 public:
  BoundedLeastNorm(const ForceTensionMatrix& a, const ForceVector& b, const TendonVector& lower,
                   const TendonVector& upper)
      : a_(a), b_(b), lower_(lower), upper_(upper) {}

  struct Solution {
    TendonVector x;
    double error;    // |A x - b|
    int iterations;  // of Newton
    bool converged;
  };

  Solution Solve() noexcept {
    const int iterations = FindActiveSet();
    const TendonVector exact = Polish();
    const double exact_miss = (a_ * exact - b_).norm(), near_miss = (a_ * near_ - b_).norm();
    const bool improved = exact_miss <= near_miss + 1e-12 * (b_.norm() + exact.norm());
    return {improved ? exact : near_, improved ? exact_miss : near_miss, std::abs(iterations),
            iterations > 0};
  }

 private:
  static constexpr int kMaxIterations = 60;
  static constexpr double kRegularisation = 1e-8;

  /// Newton on the dual with an exact line search. Ends after finitely many steps; their number is bounded
  /// nevertheless. Returns it, negative at the bound.
  int FindActiveSet() noexcept {
    ForceVector y = ForceVector::Zero(b_.size());
    TendonVector pull = TendonVector::Zero(a_.cols());  // A^T y
    set_.fill(Bound::kFree);
    for (int iteration = 1; iteration <= kMaxIterations; ++iteration) {
      ForceMatrix hessian = ForceMatrix::Identity(b_.size(), b_.size()) * kRegularisation;
      TendonVector x(a_.cols());
      for (int j = 0; j < a_.cols(); ++j) {
        x[j] = iteration == 1 ? pull[j] : std::clamp(pull[j], lower_[j], upper_[j]);
        if (set_[j] == Bound::kFree) hessian.noalias() += a_.col(j) * a_.col(j).transpose();
      }
      const ForceVector gradient = a_ * x + kRegularisation * y - b_;
      near_ = x.cwiseMax(lower_).cwiseMin(upper_);
      if (iteration > 1 && gradient.norm() <= 1e-15 * (b_.norm() + x.norm() + y.norm())) return iteration;
      const ForceVector step = -hessian.ldlt().solve(gradient);
      const TendonVector step_pull = a_.transpose() * step;
      const double length = iteration == 1 ? 1 : LineSearch(y, pull, step, step_pull);
      y += length * step;
      pull = a_.transpose() * y;
      const BoundSet previous = set_;
      Classify(pull);
      if (length == 1 && previous == set_) {
        near_ = pull.cwiseMax(lower_).cwiseMin(upper_);
        return iteration;
      }
    }
    return -kMaxIterations;
  }

  /// The exact solution on the active set that Solve found: x at its bounds, the free ones of least norm.
  /// Errors of the set within the regularisation of a bound are corrected: free tensions beyond a bound are
  /// fixed at it, then one that would reduce the residual by leaving its bound is freed.
  TendonVector Polish() noexcept {
    TendonVector x = OnActiveSet();
    for (int attempt = 0; attempt < 2 * a_.cols(); ++attempt) {
      bool moved = false;
      for (int j = 0; j < a_.cols(); ++j) {
        if (set_[j] != Bound::kFree || (x[j] >= lower_[j] && x[j] <= upper_[j])) continue;
        set_[j] = x[j] < lower_[j] ? Bound::kLower : Bound::kUpper;
        moved = true;
      }
      if (!moved && !FreeOne(x)) break;
      x = OnActiveSet();
    }
    return x.cwiseMax(lower_).cwiseMin(upper_);
  }

  /// Frees the bounded tension that reduces the residual most; false: none does.
  bool FreeOne(const TendonVector& x) noexcept {
    const ForceVector missing = b_ - a_ * x;
    double most = 1e-12 * (b_.norm() + x.norm());
    int freed = -1;
    for (int j = 0; j < a_.cols(); ++j) {
      const double gain = (set_[j] == Bound::kLower ? 1 : -1) * a_.col(j).dot(missing);
      if (set_[j] == Bound::kFree || gain <= most) continue;
      most = gain;
      freed = j;
    }
    if (freed >= 0) set_[freed] = Bound::kFree;
    return freed >= 0;
  }

  void Classify(const TendonVector& pull) noexcept {
    for (int j = 0; j < a_.cols(); ++j) {
      set_[j] = pull[j] <= lower_[j] ? Bound::kLower : pull[j] >= upper_[j] ? Bound::kUpper : Bound::kFree;
    }
  }

  /// Length in (0, 1] at which the derivative along the step, a rising piecewise linear function, crosses
  /// zero; 1 if it does not.
  double LineSearch(const ForceVector& y, const TendonVector& pull, const ForceVector& step,
                    const TendonVector& step_pull) const noexcept {
    const double constant = kRegularisation * step.dot(y) - step.dot(b_);
    const double linear = kRegularisation * step.squaredNorm();
    const auto derivative = [&](double t) {
      double sum = constant + linear * t;
      for (int j = 0; j < pull.size(); ++j)
        sum += step_pull[j] * std::clamp(pull[j] + t * step_pull[j], lower_[j], upper_[j]);
      return sum;
    };
    if (derivative(1) <= 0) return 1;
    std::array<double, 2 * kMaxTendons + 2> kinks;
    int count = 0;
    kinks[count++] = 0;
    for (int j = 0; j < pull.size(); ++j) {
      for (const double bound : {lower_[j], upper_[j]}) {
        const double t = (bound - pull[j]) / step_pull[j];
        if (t > 0 && t < 1) kinks[count++] = t;
      }
    }
    kinks[count++] = 1;
    std::sort(kinks.begin(), kinks.begin() + count);
    int low = 0, high = count - 1;  // the crossing lies between these kinks
    while (high - low > 1) {
      const int middle = (low + high) / 2;
      (derivative(kinks[middle]) <= 0 ? low : high) = middle;
    }
    const double at_low = derivative(kinks[low]), at_high = derivative(kinks[high]);
    if (!(at_high > at_low)) return kinks[high];
    return kinks[low] - at_low * (kinks[high] - kinks[low]) / (at_high - at_low);
  }

  TendonVector OnActiveSet() const noexcept {
    TendonVector x = TendonVector::Zero(a_.cols());
    ForceTensionMatrix free(b_.size(), a_.cols());
    std::array<int, kMaxTendons> index{};
    int count = 0;
    ForceVector rest = b_;
    for (int j = 0; j < a_.cols(); ++j) {
      if (set_[j] == Bound::kFree) {
        index[count] = j;
        free.col(count++) = a_.col(j);
      } else {
        x[j] = set_[j] == Bound::kUpper ? upper_[j] : lower_[j];
        if (x[j] != 0) rest -= x[j] * a_.col(j);
      }
    }
    if (count == 0) return x;
    free.conservativeResize(Eigen::NoChange, count);
    const TendonVector solved = LeastNorm(free, rest);
    for (int i = 0; i < count; ++i) x[index[i]] = solved[i];
    return x;
  }

  static TendonVector LeastNorm(const ForceTensionMatrix& a, const ForceVector& b) noexcept {
    if (a.cols() >= a.rows()) {
      const ForceMatrix gram = a * a.transpose();
      const Eigen::LLT<ForceMatrix> factor(gram);
      if (factor.info() == Eigen::Success && factor.rcond() > 1e-10) {
        ForceVector y = factor.solve(b);
        y += factor.solve(b - gram * y);
        TendonVector x = a.transpose() * y;
        x += a.transpose() * factor.solve(b - a * x);
        return x;
      }
    }
    Eigen::CompleteOrthogonalDecomposition<ForceTensionMatrix> factor;
    factor.setThreshold(1e-9);
    factor.compute(a);
    return Solved(factor, b);
  }

  /// factor.solve(b) in steps: Eigen's own allocates a temporary for rank-deficient matrices.
  static TendonVector Solved(const Eigen::CompleteOrthogonalDecomposition<ForceTensionMatrix>& factor,
                             const ForceVector& b) noexcept {
    const Eigen::Index rank = factor.rank(), cols = factor.cols();
    TendonVector x = TendonVector::Zero(cols);
    if (rank == 0) return x;
    ForceVector c = b;
    c.applyOnTheLeft(factor.matrixQ().setLength(rank).adjoint());
    x.head(rank) =
        factor.matrixT().topLeftCorner(rank, rank).triangularView<Eigen::Upper>().solve(c.head(rank));
    for (Eigen::Index k = 0; rank < cols && k < rank; ++k) {
      double one_column = 0;
      std::swap(x[k], x[rank - 1]);
      x.segment(rank - 1, cols - rank + 1)
          .applyHouseholderOnTheLeft(factor.matrixQTZ().row(k).tail(cols - rank).adjoint(),
                                     factor.zCoeffs()(k), &one_column);
      std::swap(x[k], x[rank - 1]);
    }
    x = factor.colsPermutation() * x;
    return x;
  }

  const ForceTensionMatrix& a_;
  const ForceVector& b_;
  const TendonVector &lower_, &upper_;
  BoundSet set_{};
  TendonVector near_;  // the solution up to the regularisation
};

/// The bound at which a tension would reduce the residual by moving on from x; `gain` is the reduction for
/// each tension.
Status BoundThatHolds(const TendonVector& gain, const TendonVector& x, const TendonVector& lower,
                      const TendonVector& upper, double least_gain) {
  Status bound = Status::kOk;
  for (int j = 0; j < x.size(); ++j) {
    if (x[j] >= upper[j] && gain[j] > least_gain) return Status::kLimitedTensionMax;
    if (x[j] > lower[j] || gain[j] >= -least_gain) continue;
    if (lower[j] < 0) return Status::kLimitedTensionMax;  // a pair's other tendon pulls no more
    bound = Status::kLimitedTensionMin;
  }
  return bound;
}

/// force = jacobian * x with x from start + lower to start + upper, nearest to the start.
TensionAllocator::Result AllocateFrom(const TendonVector& start_N,
                                      const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                                      ConstVectorRef force_Nm, const TendonVector& lower_N,
                                      const TendonVector& upper_N) noexcept {
  const auto columns = static_cast<int>(jacobian.cols()), forces = static_cast<int>(jacobian.rows());
  TensionAllocator::Result result;
  result.tension_N = start_N;
  double scale = 0;
  for (int j = 0; j < columns; ++j) scale = std::max(scale, jacobian.col(j).norm());
  if (!(scale > 0) || !jacobian.allFinite() || !force_Nm.allFinite() || !start_N.allFinite() ||
      upper_N.array().isNaN().any()) {
    result.residual_Nm = force_Nm.norm();
    result.status = result.bound = Status::kSolverFallback;
    return result;
  }
  const ForceTensionMatrix a = jacobian / scale;
  const ForceVector b = force_Nm / scale - a * result.tension_N;
  std::optional<BoundedLeastNorm::Solution> found;
  bool every_force = true;  // could be produced without bounds
  if (columns < forces) {
    every_force = false;
  } else if (!WellConditioned(a)) {
    // Orthonormalised equations have the same solutions, however badly conditioned they were.
    const Eigen::HouseholderQR<TensionForceMatrix> factor(a.transpose());
    const auto upper = factor.matrixQR().topRows(forces).triangularView<Eigen::Upper>();
    every_force = factor.matrixQR().diagonal().cwiseAbs().minCoeff() > 1e-10;
    if (every_force) {
      TensionForceMatrix thin(columns, forces);
      thin.setIdentity();
      thin.applyOnTheLeft(factor.householderQ());
      const ForceTensionMatrix rows = thin.transpose();
      const ForceVector right = upper.transpose().solve(b);
      found = BoundedLeastNorm(rows, right, lower_N, upper_N).Solve();
      result.iterations = found->iterations;
      if (!(found->error <= 1e-10 * (right.norm() + found->x.norm()))) found.reset();
    }
  }
  // The nearest force, if none is reached, depends on the original equations.
  if (!found) {
    found = BoundedLeastNorm(a, b, lower_N, upper_N).Solve();
    result.iterations += found->iterations;
    if (!found->converged) result.status = Status::kSolverFallback;
  }
  result.tension_N += found->x;
  const double most_range_N = (upper_N - lower_N).maxCoeff();
  const ForceVector missing = b - a * found->x;
  const double exact_Nm = 1e-10 * (force_Nm.norm() + scale * (most_range_N < 1e6 ? most_range_N : 1.0));
  result.residual_Nm = scale * missing.norm();
  if (result.residual_Nm > exact_Nm) result.status = Status::kLimitedTensionMax;
  result.bound = every_force
                     ? result.status
                     : BoundThatHolds(a.transpose() * missing, found->x, lower_N, upper_N, exact_Nm / scale);
  return result;
}

}  // namespace

TensionAllocator::TensionAllocator(int tendons, int forces, TendonPairs pairs)
    : tendons_(tendons), forces_(forces), pairs_(std::move(pairs)) {
  if (tendons < 1 || tendons > kMaxTendons) {
    throw std::invalid_argument("tension allocation: " + std::to_string(tendons) +
                                " tendons: accepted 1 .. " + std::to_string(kMaxTendons));
  }
  if (forces < 1 || forces > kMaxForces) {
    throw std::invalid_argument("tension allocation: " + std::to_string(forces) + " forces: accepted 1 .. " +
                                std::to_string(kMaxForces));
  }
  shortening_m_ = offset_N_ = TendonVector::Zero(tendons);
}

TensionAllocator::Result TensionAllocator::Allocate(const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                                                    ConstVectorRef force_Nm, double min_tension_N,
                                                    double max_tension_N) const noexcept {
  return Allocate(jacobian, force_Nm, min_tension_N,
                  TendonVector(TendonVector::Constant(tendons_, max_tension_N)));
}

TensionAllocator::Result TensionAllocator::Allocate(const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                                                    ConstVectorRef force_Nm, double min_tension_N,
                                                    const TendonVector& max_tension_N) const noexcept {
  assert(jacobian.rows() == forces_ && jacobian.cols() == tendons_ && force_Nm.size() == forces_);
  if (!pairs_.empty()) return AllocatePairs(jacobian, force_Nm, min_tension_N, max_tension_N);
  return AllocateFrom(TendonVector::Constant(tendons_, min_tension_N), jacobian, force_Nm,
                      TendonVector::Zero(tendons_),
                      (max_tension_N.array() - min_tension_N).max(0.0).matrix());
}

// A pair is one unknown: x = (T_a - T_b) / sqrt 2, whose square is that of the two tensions' change where the
// tendons are alike. It begins at zero, with both tendons unpulled.
TensionAllocator::Result TensionAllocator::AllocatePairs(const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                                                         ConstVectorRef force_Nm, double min_tension_N,
                                                         const TendonVector& max_tension_N) const noexcept {
  const TendonVector unpulled_N = Unpulled_N(min_tension_N);
  const auto drives = tendons_ - static_cast<Eigen::Index>(pairs_.all().size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxForces, kMaxTendons> columns(forces_, drives);
  TendonVector start = TendonVector::Zero(drives), lower = start, upper = start;
  ForceVector rest_Nm = force_Nm;
  std::array<int, kMaxTendons> column_of{};
  column_of.fill(-1);
  Eigen::Index c = 0;
  for (const TendonPairs::Pair& pair : pairs_.all()) {
    const double a = pair.first_share, b = 1 - a;
    columns.col(c) = std::numbers::sqrt2 * (a * jacobian.col(pair.first) - b * jacobian.col(pair.second));
    rest_Nm -= unpulled_N[pair.first] * (jacobian.col(pair.first) + jacobian.col(pair.second));
    const auto pulls = pair.PullsWithin(unpulled_N[pair.first], pairs_.least_N(), max_tension_N[pair.first],
                                        max_tension_N[pair.second]);
    upper[c] = std::max(pulls.most_N / std::numbers::sqrt2, kLeastPull_N);
    lower[c] = std::min(pulls.least_N / std::numbers::sqrt2, -kLeastPull_N);
    column_of[pair.first] = column_of[pair.second] = static_cast<int>(c++);
  }
  for (int j = 0; j < tendons_; ++j) {
    if (column_of[j] >= 0) continue;
    columns.col(c) = jacobian.col(j);
    start[c] = min_tension_N;
    upper[c] = std::max(0.0, max_tension_N[j] - min_tension_N);
    column_of[j] = static_cast<int>(c++);
  }
  Result result = AllocateFrom(start, columns, rest_Nm, lower, upper);
  const TendonVector x = result.tension_N;
  result.tension_N.resize(tendons_);
  for (int j = 0; j < tendons_; ++j) result.tension_N[j] = x[column_of[j]];
  for (const TendonPairs::Pair& pair : pairs_.all()) {
    pair.Split(unpulled_N[pair.first], std::numbers::sqrt2 * x[column_of[pair.first]], result.tension_N);
  }
  return result;
}

void TensionAllocator::Bend(const Body& body, ConstVectorRef q) noexcept {
  if (!pairs_.empty()) body.TendonShortening(q, shortening_m_);
}

void TensionAllocator::AddFriction(const TendonVector& offset_N) noexcept {
  if (!pairs_.empty()) offset_N_ = offset_N;
}

TendonVector TensionAllocator::Unpulled_N(double min_tension_N) const noexcept {
  TendonVector unpulled_N = TendonVector::Constant(tendons_, min_tension_N);
  for (const TendonPairs::Pair& pair : pairs_.all())
    unpulled_N[pair.first] = unpulled_N[pair.second] =
        TendonPairs::Unpulled_N(pair, shortening_m_) + offset_N_[pair.first];
  return unpulled_N;
}

void SectionForcePerTension(const Body& body, const BendingVector& us_vs, MatrixRef jacobian) noexcept {
  UnitVector q(body.dof());
  body.SpreadBending(us_vs, q);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxTendons, 2 * kMaxUnits> length(body.tendons(),
                                                                                              body.dof());
  body.TendonLengthJacobian(q, length);
  // As ProjectForce does with the force -dL_j/dq of a unit tension.
  for (int k = 0; k < body.sections(); ++k) {
    const int first = body.first_unit(k), units = body.end_unit(k) - first;
    for (int j = 0; j < body.tendons(); ++j) {
      double u = 0, v = 0;
      for (int i = first; i < first + units; ++i) {
        u -= length(j, 2 * i);
        v -= length(j, 2 * i + 1);
      }
      jacobian(2 * k, j) = u / units;
      jacobian(2 * k + 1, j) = v / units;
    }
  }
}

}  // namespace tendril::model
