// Prior odds times evidence; what is too small to matter counts as no change.
#include "posterior.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "../judge.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

// Prior probabilities: of no change, of one in the library, of one outside it.
constexpr double kNone = 0.5, kListed = 0.4, kUnlisted = 0.1;
// Half of a 95 % interval of the mean of kQuarters values, in standard errors (Student, three degrees).
constexpr double kOfQuarters95 = 3.182;

double NormalCdf(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

/// Probability that a fitted change is larger than what does not matter.
double Matters(const ChangeFit& fit) {
  if (fit.held_out_m.size() == 0) return 1;  // screened
  const double sure = std::sqrt(std::max(0.0, fit.z.dot(fit.covariance.ldlt().solve(fit.z))));
  return fit.moves > 0 ? NormalCdf(sure * (1 - 1 / fit.moves)) : 0;
}

/// What the states before and after the change say of one search.
class Weighing {
 public:
  Weighing(const LearnedPostures& learned, const ChangeSearch& search, double delta_m)
      : learned_(learned), search_(search), delta_m_(delta_m) {}

  ChangePosterior Result() {
    const double gap = WeighHypotheses();
    p_.not_learned = !learned_.Predicts();
    // No hypothesis is certain.
    const double shown = gap >= 0.5 ? gap : kUnseen + (1 - 2 * kUnseen) * gap;
    for (double& its : p_.fits) its *= (1 - kLapse) * (gap > 0 ? shown / gap : 0);
    p_.none = std::max(0.0, 1 - shown);
    if (!search_.fits.empty() && gap >= 0.5) CheckBest();
    if (p_.not_learned) Distrust();
    p_.unlisted = 1 - p_.none - std::accumulate(p_.fits.begin(), p_.fits.end(), 0.0);
    return std::move(p_);
  }

 private:
  int points() const { return static_cast<int>(search_.before_m.cols()) / 3; }

  const PostureChange& ChangeOf(const ChangeFit& fit) const {
    return search_.changes[static_cast<std::size_t>(fit.change)];
  }

  /// The probability of a change that matters.
  double WeighHypotheses() {
    const double none = std::log(kNone) + search_.none_log_evidence;
    const double unlisted = std::log(kUnlisted) + search_.unlisted_log_evidence;
    double top = std::max(none, unlisted);
    const auto log_joint = [](const ChangeFit& fit) { return std::log(kListed) + fit.LogJoint(); };
    for (const ChangeFit& fit : search_.fits) top = std::max(top, log_joint(fit));
    double sum = std::exp(none - top) + std::exp(unlisted - top);
    for (const ChangeFit& fit : search_.fits) sum += std::exp(log_joint(fit) - top);
    double gap = AnyExcess(search_.before_m) ? std::exp(unlisted - top) / sum : 0;
    for (const ChangeFit& fit : search_.fits) {
      p_.fits.push_back(Matters(fit) * std::exp(log_joint(fit) - top) / sum);
      p_.same.push_back(search_.fits.front().log_evidence - fit.log_evidence < kSame);
      gap += p_.fits.back();
    }
    return gap;
  }

  /// Nothing is likelier than not.
  void Distrust() {
    double most = p_.none;
    for (const double its : p_.fits) most = std::max(most, its);
    if (most <= 0.5) return;
    p_.none *= 0.5 / most;
    for (double& its : p_.fits) its *= 0.5 / most;
  }

  bool AnyExcess(const Eigen::MatrixXd& residuals) const {
    for (int p = 0; p < points(); ++p) {
      if (HasExcess(learned_, residuals, p, delta_m_)) return true;
    }
    return false;
  }

  /// A cause that closes too little or leaves too much is not established, whatever the alternatives.
  void CheckBest() {
    const Eigen::MatrixXd& after = search_.fits.front().held_out_m;
    if (after.size() == 0) return;  // no change of the library can be
    p_.closed = Closed(after);
    for (int p = 0; p < points(); ++p)
      p_.leftover_sigma = std::max(p_.leftover_sigma, Excess(learned_, after, p) / learned_.Floor(p));
    if (p_.closed && p_.closed->value < 1 - kMayStay) {
      p_.doubt = fmt::format("it closes {} of the gap on held-out states, and a cause has to close {}",
                             Percent(p_.closed->value), Percent(1 - kMayStay));
    } else if (p_.leftover_sigma > kMostLeft_sigma) {
      p_.doubt = fmt::format("{:.2g} sigma beyond the floor remain", p_.leftover_sigma);
    } else {
      p_.doubt = ChangeOf(search_.fits.front()).OutOfRange(search_.fits.front().z);
    }
    const double first = *std::max_element(p_.fits.begin(), p_.fits.end());
    if (p_.doubt.empty() || first <= 0.5) return;
    for (double& its : p_.fits) its *= 0.5 / first;
  }

  /// Share of the excess mean square that goes, over some states and the points that have an excess in all.
  std::optional<double> ClosedIn(const Eigen::MatrixXd& after, const StateRange& range) const {
    double had = 0, has = 0;
    for (int p = 0; p < points(); ++p) {
      if (!HasExcess(learned_, search_.before_m, p, delta_m_)) continue;
      const auto in_floors = [&](const Eigen::MatrixXd& residuals) {
        return std::pow(PointRms(residuals.middleRows(range.first, range.count), p) / learned_.Floor(p), 2);
      };
      had += in_floors(search_.before_m) - 1;
      has += in_floors(after) - 1;
    }
    if (had <= 0) return std::nullopt;
    return 1 - std::max(0.0, has) / had;
  }

  std::optional<Estimate> Closed(const Eigen::MatrixXd& after) const {
    const auto all = ClosedIn(after, {0, after.rows()});
    if (!all) return std::nullopt;
    double sum = 0, squares = 0;
    int count = 0;
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      const auto part = ClosedIn(after, QuarterOf(quarter, after.rows()));
      if (!part) continue;
      sum += *part;
      squares += *part * *part;
      ++count;
    }
    if (count < kQuarters) return Estimate{*all, -1, 1};
    const double variance = std::max(0.0, squares / count - std::pow(sum / count, 2)) / (count - 1);
    const double half = kOfQuarters95 * std::sqrt(variance);
    return Estimate{*all, *all - half, std::min(1.0, *all + half)};
  }

  const LearnedPostures& learned_;
  const ChangeSearch& search_;
  const double delta_m_;
  ChangePosterior p_;
};

}  // namespace

ChangePosterior PosteriorOf(const LearnedPostures& learned, const ChangeSearch& search, double delta_m) {
  return Weighing(learned, search, delta_m).Result();
}

}  // namespace tendril::gap
