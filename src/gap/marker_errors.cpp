#include "marker_errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>

#include "median.h"
#include "prepare.h"

namespace tendril::gap {
namespace {

// A frame is not where the marker is, or markers are not where they were, from this share of the length on:
// far beyond a tracker's noise and the motion between frames, below the distance of two disks.
constexpr double kElsewhere = 0.05;
constexpr double kPlainly = 0.5;  // distance that the right names leave, of that with the wrong ones
// Frames on either side that say where a marker is, at most and at least.
constexpr int kFrames = 5, kLeast = 2;
constexpr double kUsual = 10;  // times the usual distance from them

class Markers {
 public:
  Markers(Run& run, double length_m, std::vector<std::string>& said)
      : run_(run), far_m_(kElsewhere * length_m), said_(said) {
    for (Eigen::Index d = 0; 3 * d + 2 < run.disks_m.cols(); ++d) {
      if (run.disks_m.middleCols(3 * d, 3).array().isFinite().any()) seen_.push_back(d);
    }
  }

  void Mask() {
    Exchanged();
    for (const Eigen::Index d : seen_) Leaps(d);
  }

 private:
  auto At(Eigen::Index row, Eigen::Index disk) const { return run_.disks_m.row(row).segment<3>(3 * disk); }
  bool There(Eigen::Index row, Eigen::Index disk) const { return At(row, disk).allFinite(); }

  void Drop(Eigen::Index row, Eigen::Index disk) {
    run_.disks_m.row(row).segment<3>(3 * disk).setConstant(kNoReading);
  }

  void Say(const std::string& what, Eigen::Index first, std::size_t frames) const {
    said_.push_back(fmt::format("{}: {} in {} frame{}, first at {:.4g} s: taken as missing there", run_.name,
                                what, frames, frames == 1 ? "" : "s", run_.time_s[first] - run_.time_s[0]));
  }

  /// Follows every marker, whatever its name in a frame; which is which at the start is taken from the names.
  void Exchanged() {
    std::vector<std::optional<Eigen::RowVector3d>> last(static_cast<std::size_t>(run_.disks_m.cols() / 3));
    std::vector<std::set<Eigen::Index>> wrong(seen_.size());  // rows
    for (Eigen::Index row = 0; row < run_.disks_m.rows(); ++row) {
      std::vector<Eigen::Index> name(seen_.begin(), seen_.end());  // under which each of seen_ is found
      for (std::size_t a = 0; a < seen_.size(); ++a) {
        for (std::size_t b = a + 1; b < seen_.size(); ++b) {
          if (AreExchanged(row, seen_[a], seen_[b], last)) std::swap(name[a], name[b]);
        }
      }
      for (std::size_t k = 0; k < seen_.size(); ++k) {
        if (There(row, name[k])) last[static_cast<std::size_t>(seen_[k])] = At(row, name[k]);
        if (name[k] != seen_[k]) wrong[k].insert(row);
      }
    }
    std::set<Eigen::Index> rows;
    for (std::size_t k = 0; k < seen_.size(); ++k) {
      for (const Eigen::Index row : TheFewer(wrong[k], seen_[k])) {
        Drop(row, seen_[k]);
        rows.insert(row);
      }
    }
    if (!rows.empty()) Say("markers have each other's names", *rows.begin(), rows.size());
  }

  /// These rows, or where they are most the others: then the names were exchanged at the start.
  std::set<Eigen::Index> TheFewer(const std::set<Eigen::Index>& rows, Eigen::Index disk) const {
    std::set<Eigen::Index> others;
    for (Eigen::Index row = 0; row < run_.disks_m.rows(); ++row) {
      if (There(row, disk) && !rows.contains(row)) others.insert(row);
    }
    return others.size() < rows.size() ? others : rows;
  }

  bool AreExchanged(Eigen::Index row, Eigen::Index a, Eigen::Index b,
                    const std::vector<std::optional<Eigen::RowVector3d>>& last) const {
    const auto &a0 = last[static_cast<std::size_t>(a)], &b0 = last[static_cast<std::size_t>(b)];
    if (!a0 || !b0) return false;
    double named = 0, exchanged = 0;  // of those that are seen
    const auto add = [&](Eigen::Index disk, const Eigen::RowVector3d& its, const Eigen::RowVector3d& other) {
      if (!There(row, disk)) return;
      named += (At(row, disk) - its).norm();
      exchanged += (At(row, disk) - other).norm();
    };
    add(a, *a0, *b0);
    add(b, *b0, *a0);
    return named > far_m_ && exchanged < kPlainly * named;
  }

  /// Of the k-th of the rows with a reading, from the median of those around; none where they are too few, as
  /// at the ends of the run.
  std::optional<double> OffNeighbours(const std::vector<Eigen::Index>& rows, int k, Eigen::Index disk) const {
    constexpr double kRounding_s = 1e-6;
    const auto row = [&](int i) { return rows[static_cast<std::size_t>(i)]; };
    std::vector<Eigen::Index> around;
    int before = 0, after = 0;
    for (int i = std::max(0, k - kFrames); i <= std::min(k + kFrames, static_cast<int>(rows.size()) - 1);
         ++i) {
      if (std::abs(run_.time_s[row(i)] - run_.time_s[row(k)]) > kQuasiStatic_s + kRounding_s) continue;
      around.push_back(row(i));
      before += i < k;
      after += i > k;
    }
    if (before < kLeast || after < kLeast) return {};
    double square = 0;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const Eigen::VectorXd its = run_.disks_m.col(3 * disk + axis)(around);
      square += std::pow(run_.disks_m(row(k), 3 * disk + axis) - Median({its.begin(), its.end()}), 2);
    }
    return std::sqrt(square);
  }

  void Leaps(Eigen::Index disk) {
    std::vector<Eigen::Index> read, rows;
    for (Eigen::Index row = 0; row < run_.disks_m.rows(); ++row) {
      if (There(row, disk)) read.push_back(row);
    }
    std::vector<double> off;
    for (int k = 0; k < static_cast<int>(read.size()); ++k) {
      const auto its = OffNeighbours(read, k, disk);
      if (!its) continue;
      off.push_back(*its);
      rows.push_back(read[static_cast<std::size_t>(k)]);
    }
    const double most = std::max(kUsual * Median(off), far_m_);
    std::vector<Eigen::Index> leaps;
    for (std::size_t k = 0; k < rows.size(); ++k) {
      if (off[k] > most) leaps.push_back(rows[k]);
    }
    if (leaps.empty()) return;
    for (const Eigen::Index row : leaps) Drop(row, disk);
    Say(fmt::format("the marker of disk {} leaps away and back", disk + 1), leaps.front(), leaps.size());
  }

  Run& run_;
  const double far_m_;
  std::vector<std::string>& said_;
  std::vector<Eigen::Index> seen_;  // disks with a marker
};

}  // namespace

void MaskMarkerErrors(Run& run, double length_m, std::vector<std::string>& said) {
  if (run.disks_m.rows() != run.time_s.size() || UsualStep(run) > kQuasiStatic_s) return;
  Markers(run, length_m, said).Mask();
}

}  // namespace tendril::gap
