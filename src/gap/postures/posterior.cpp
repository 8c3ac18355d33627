// Prior odds times evidence; what is too small to matter counts as no change.
#include "posterior.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "../judge.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

// Prior probabilities: of no change, of one in the library (shared evenly), of one outside it.
constexpr double kNone = 0.5, kListed = 0.4, kUnlisted = 0.1;
// Floors that an established cause may leave.
constexpr double kMostLeft_sigma = 5;
// Log of the ratio at which two are not told apart.
constexpr double kSame = 3;
constexpr double kUnseen = 0.3;  // probability of a gap too small for these states where none shows

double NormalCdf(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

/// Probability that a fitted change is larger than what matters.
double Matters(const ChangeFit& fit) {
  if (!fit.refined || fit.z.size() == 0) return 1;
  const double sure = std::sqrt(std::max(1e-12, fit.z.dot(fit.covariance.ldlt().solve(fit.z))));
  return NormalCdf(sure * (1 - kMatters / std::max(fit.sigma, 1e-12)));
}

/// Share of the excess square that goes, over some states and the channels that have an excess in all.
std::optional<double> ClosedIn(const LearnedPostures& learned, const Eigen::MatrixXd& before,
                               const Eigen::MatrixXd& after, Eigen::Index first, Eigen::Index count) {
  double had = 0, has = 0;
  for (Eigen::Index c = 0; c < before.cols(); ++c) {
    const double floor =
        learned.held_out_m.col(c).squaredNorm() / static_cast<double>(learned.held_out_m.rows());
    const double all = before.col(c).squaredNorm() / static_cast<double>(before.rows());
    if (all < 1.25 * floor) continue;
    had += (before.col(c).segment(first, count).squaredNorm() / static_cast<double>(count) - floor) / floor;
    has += (after.col(c).segment(first, count).squaredNorm() / static_cast<double>(count) - floor) / floor;
  }
  if (had <= 0) return std::nullopt;
  return 1 - std::max(0.0, has) / had;
}

std::optional<Estimate> Closed(const LearnedPostures& learned, const Eigen::MatrixXd& before,
                               const Eigen::MatrixXd& after) {
  const Eigen::Index states = before.rows();
  const auto all = ClosedIn(learned, before, after, 0, states);
  if (!all) return std::nullopt;
  Estimate closed{*all, *all, *all};
  for (int quarter = 0; quarter < kQuarters; ++quarter) {
    const Eigen::Index first = states * quarter / kQuarters;
    const auto part = ClosedIn(learned, before, after, first, states * (quarter + 1) / kQuarters - first);
    if (!part) continue;
    closed.low = std::min(closed.low, *part);
    closed.high = std::max(closed.high, *part);
  }
  return closed;
}

double WorstExcess(const LearnedPostures& learned, const Eigen::MatrixXd& left) {
  double worst = 0;
  for (int d = 0; d < static_cast<int>(left.cols()) / 3; ++d)
    worst = std::max(worst, ExcessSigma(DiskRms(left, d), DiskRms(learned.held_out_m, d)));
  return worst;
}

}  // namespace

double DiskRms(const Eigen::MatrixXd& left_m, int disk) {
  return std::sqrt(left_m.middleCols(3 * disk, 3).squaredNorm() / static_cast<double>(left_m.rows()));
}

double ExcessSigma(double rms, double floor) {
  return rms > floor ? std::sqrt(rms * rms - floor * floor) / floor : 0;
}

ChangePosterior PosteriorOf(const LearnedPostures& learned, const ChangeSearch& search) {
  ChangePosterior p;
  p.excess_sigma = WorstExcess(learned, search.before_m);
  const double each = std::log(kListed / static_cast<double>(std::max<std::size_t>(1, search.fits.size())));
  const double none = std::log(kNone) + search.none.log_evidence;
  const double unlisted = std::log(kUnlisted) + search.unlisted_log_evidence;
  double top = std::max(none, unlisted);
  for (const ChangeFit& fit : search.fits) top = std::max(top, each + fit.log_evidence);
  double sum = std::exp(none - top) + std::exp(unlisted - top);
  for (const ChangeFit& fit : search.fits) sum += std::exp(each + fit.log_evidence - top);
  p.unlisted = p.excess_sigma > kMatters ? std::exp(unlisted - top) / sum : 0;
  double listed = 0;
  for (const ChangeFit& fit : search.fits) {
    p.fits.push_back(Matters(fit) * std::exp(each + fit.log_evidence - top) / sum);
    listed += p.fits.back();
    const bool same = search.fits.front().log_evidence - fit.log_evidence < kSame;
    p.group.push_back(same ? 1 : 0);
  }
  if (std::count(p.group.begin(), p.group.end(), 1) == 1) p.group.front() = 0;
  // No hypothesis is certain.
  const double gap = p.unlisted + listed;
  const double shown = gap >= 0.5 ? gap : kUnseen + (1 - 2 * kUnseen) * gap;
  const double scale = gap > 0 ? shown / gap : 0;
  for (double& its : p.fits) its *= scale * (1 - kLapse);
  p.none = 1 - shown;
  if (!search.fits.empty() && gap >= 0.5) {
    const ChangeFit& best = search.fits.front();
    p.closed = Closed(learned, search.before_m, best.held_out_m);
    p.leftover_sigma = WorstExcess(learned, best.held_out_m);
    if (p.closed && p.closed->value < 1 - kMayStay) {
      p.doubt = fmt::format("it closes {} of the gap on held-out states, and a cause has to close {}",
                            Percent(p.closed->value), Percent(1 - kMayStay));
    } else if (p.leftover_sigma > kMostLeft_sigma) {
      p.doubt = fmt::format("{:.2g} sigma beyond the floor remain", p.leftover_sigma);
    }
    const double first = p.fits.empty() ? 0 : *std::max_element(p.fits.begin(), p.fits.end());
    if (!p.doubt.empty() && first > 0.5) {
      for (double& its : p.fits) its *= 0.5 / first;
    }
  }
  listed = 0;
  for (const double its : p.fits) listed += its;
  p.unlisted = 1 - p.none - listed;
  return p;
}

}  // namespace tendril::gap
