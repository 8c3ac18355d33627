#include "free_numbers.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <regex>

#include "tendril/core/uncertainty.h"

namespace tendril::gap {
namespace {

// An unknown number is in the file within a factor of ten, an unknown angle within half a turn (two standard
// deviations).
constexpr double kUnknownFactor = 1.15, kUnknown_rad = std::numbers::pi / 2;
// Of the deviations of one kind of number over the tendons: made by the same hand with the same drill.
constexpr double kToleranceShared = 0.8;

/// A key of the file without places in lists and tendons, as those of FileNumber: "actuation.gear.ratio" for
/// "actuation.per_tendon.2.gear.ratio".
std::string WithoutPlaces(const std::string& key) {
  static const std::regex kPlaces(R"(\[\d+\]|per_tendon\.\d+\.)");
  return std::regex_replace(key, kPlaces, "");
}

/// The key of a hole's number in the file: "body.sections[1].tendons[2].radius_m".
std::string KeyOfHole(const BodyParameters& body, const FileNumber& number) {
  int tendon = number.tendon;
  const std::string word = number.key.substr(number.key.rfind(' ') + 1);
  for (std::size_t k = 0; k < body.sections.size(); ++k) {
    const int count = static_cast<int>(body.sections[k].tendons.size());
    if (tendon <= count) return fmt::format("body.sections[{}].tendons[{}].{}", k + 1, tendon, word);
    tendon -= count;
  }
  return {};
}

/// What the file says of a number, else what is usual. Of a number common to sections or tendons: what it
/// says of all of them, else of the first of which it says anything.
Uncertainty UncertaintyOf(const RobotParameters& file, const FileNumber& number) {
  const auto own = file.uncertain.find(number.tendon > 0 ? KeyOfHole(file.body, number) : number.key);
  if (own != file.uncertain.end()) return own->second;
  for (const auto& [key, uncertainty] : file.uncertain) {
    if (number.tendon == 0 && WithoutPlaces(key) == number.key) return uncertainty;
  }
  return UsualUncertainty(WithoutTendon(number.key));
}

}  // namespace

std::optional<double> DeviationOf(double in_file, bool angle, const Uncertainty& u) {
  switch (u.kind) {
    case Uncertainty::Kind::kKnown:
      return std::nullopt;
    case Uncertainty::Kind::kUnknown:
      return angle ? kUnknown_rad : kUnknownFactor;
    case Uncertainty::Kind::kShare:
      return angle ? u.deviation * std::abs(in_file) : u.deviation;
    case Uncertainty::Kind::kAbsolute:
      return angle ? u.deviation : u.deviation / std::abs(in_file);
  }
  return std::nullopt;
}

RobotParameters FreeNumbers::Robot(const RobotParameters& file, const Eigen::VectorXd& x) const {
  RobotParameters robot = file;
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    const double change = x[static_cast<Eigen::Index>(k)];
    if (change != 0) numbers[k].apply(robot, change);
  }
  return cause ? CauseAt(x).Robot(robot) : robot;
}

Model FreeNumbers::CauseAt(const Eigen::VectorXd& x) const {
  Model at = *cause;
  if (!cause_is_free) return at;
  const Eigen::VectorXd changes = x.tail(at.size());
  for (int k = 0; k < at.size(); ++k) {
    const sim::EffectParameter& p = at.parameter(k);
    at.values[k] = std::clamp(p.nominal + changes[k] * ScaleOf(p), p.lower, p.upper);
  }
  return at;
}

FreeNumbers FreeNumbers::With(const Model& its) const {
  FreeNumbers with = *this;
  with.cause = its;
  return with;
}

FreeNumbers FreeNumbers::WithFree(const Model& its) const {
  FreeNumbers with = With(its);
  with.cause_is_free = true;
  const int n = size(), all = with.size();
  with.deviation.conservativeResize(all);
  with.deviation.tail(its.size()).setConstant(kFlatPrior);
  with.precision.setZero(all, all);
  with.precision.topLeftCorner(n, n) = precision;
  with.precision.diagonal().tail(its.size()).setConstant(1 / (kFlatPrior * kFlatPrior));
  return with;
}

Eigen::VectorXd FreeNumbers::StartAt(const Eigen::VectorXd& of_numbers) const {
  Eigen::VectorXd x(size());
  x.head(of_numbers.size()) = of_numbers;
  for (int k = 0; cause_is_free && k < cause->size(); ++k) {
    const sim::EffectParameter& p = cause->parameter(k);
    x[static_cast<Eigen::Index>(numbers.size()) + k] = (cause->values[k] - p.nominal) / ScaleOf(p);
  }
  return x;
}

FreeNumbers FreeNumbersOf(const RobotParameters& file) {
  FreeNumbers free;
  const std::vector<FileNumber> all = FileNumbers(file);
  std::vector<double> deviations;
  for (const FileNumber& number : all) {
    // Where each tendon has its own, the number common to all would be the same unknown twice.
    const bool of_each = std::any_of(all.begin(), all.end(), [&](const FileNumber& other) {
      return other.tendon > 0 && WithoutTendon(other.key) == number.key;
    });
    if (of_each || !number.may_be_open) continue;
    const auto deviation = DeviationOf(number.in_file, number.angle, UncertaintyOf(file, number));
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
    for (int b = 0; b < a; ++b) {
      const FileNumber &one = free.numbers[static_cast<std::size_t>(a)],
                       &other = free.numbers[static_cast<std::size_t>(b)];
      if (one.tendon == 0 || WithoutTendon(one.key) != WithoutTendon(other.key)) continue;
      covariance(a, b) = covariance(b, a) = kToleranceShared * free.deviation[a] * free.deviation[b];
    }
  }
  free.precision = covariance.llt().solve(Eigen::MatrixXd::Identity(n, n));
  return free;
}

}  // namespace tendril::gap
