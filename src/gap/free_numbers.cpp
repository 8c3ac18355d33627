#include "free_numbers.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "tendril/core/uncertainty.h"

namespace tendril::gap {
namespace {

// An unknown number is in the file within a factor of ten, an unknown angle within half a turn (two standard
// deviations).
constexpr double kUnknownFactor = 1.15, kUnknown_rad = std::numbers::pi / 2;
// Of the deviations of one kind of number over the tendons: made by the same hand with the same drill.
constexpr double kToleranceShared = 0.8;

/// "body.sections.tendons.radius_m" for "body.sections.tendons (tendon 2) radius_m"; else empty.
std::string KindOfOneTendons(const std::string& key) {
  const auto begin = key.find(" (tendon ");
  if (begin == std::string::npos) return {};
  return key.substr(0, begin) + "." + key.substr(key.find(") ", begin) + 2);
}

/// What the file says of a number, else what is usual.
Uncertainty UncertaintyOf(const RobotParameters&, const std::string& key) { return UsualUncertainty(key); }

/// Standard deviation of a number's change; none for one that is known.
std::optional<double> DeviationOf(const FileNumber& number, const Uncertainty& u) {
  switch (u.kind) {
    case Uncertainty::Kind::kKnown:
      return std::nullopt;
    case Uncertainty::Kind::kUnknown:
      return number.angle ? kUnknown_rad : kUnknownFactor;
    case Uncertainty::Kind::kShare:
      return number.angle ? u.deviation * std::abs(number.in_file) : u.deviation;
    case Uncertainty::Kind::kAbsolute:
      return number.angle ? u.deviation : u.deviation / std::abs(number.in_file);
  }
  return std::nullopt;
}

}  // namespace

RobotParameters FreeNumbers::Robot(const RobotParameters& file, const Eigen::VectorXd& x) const {
  RobotParameters robot = file;
  for (int k = 0; k < size(); ++k) {
    if (x[k] != 0) numbers[static_cast<std::size_t>(k)].apply(robot, x[k]);
  }
  return robot;
}

FreeNumbers FreeNumbersOf(const RobotParameters& file) {
  FreeNumbers free;
  const std::vector<FileNumber> all = FileNumbers(file);
  std::vector<double> deviations;
  for (const FileNumber& number : all) {
    // Where each tendon has its own, the number common to all would be the same unknown twice.
    const bool of_each = std::any_of(all.begin(), all.end(), [&](const FileNumber& other) {
      return KindOfOneTendons(other.key) == number.key;
    });
    // A disk's inertia moves with its mass, and a file may give it by the disk's diameter. Counts are whole, and a
    // wrong one is a mistake rather than uncertain.
    if (of_each || number.key.find("disk_inertia") != std::string::npos ||
        number.key.ends_with("encoder_counts_per_turn")) {
      continue;
    }
    const auto deviation = DeviationOf(number, UncertaintyOf(file, number.key));
    if (!deviation) {
      free.known.push_back(number.key);
      continue;
    }
    free.numbers.push_back(number);
    deviations.push_back(*deviation);
  }
  const int n = free.size();
  free.deviation = Eigen::Map<Eigen::VectorXd>(deviations.data(), n);
  Eigen::MatrixXd covariance = free.deviation.cwiseAbs2().asDiagonal();
  for (int a = 0; a < n; ++a) {
    const std::string kind = KindOfOneTendons(free.numbers[static_cast<std::size_t>(a)].key);
    for (int b = 0; b < a && !kind.empty(); ++b) {
      if (KindOfOneTendons(free.numbers[static_cast<std::size_t>(b)].key) != kind) continue;
      covariance(a, b) = covariance(b, a) = kToleranceShared * free.deviation[a] * free.deviation[b];
    }
  }
  free.precision = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  return free;
}

}  // namespace tendril::gap
