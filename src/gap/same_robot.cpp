// Entries that no correction of a robot file changes identify a robot; entries that a correction may change
// do so beyond plausible bounds.
#include "same_robot.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "tendril/config/config.h"
#include "tendril/sim/effects.h"
#include "text.h"

namespace tendril::gap {
namespace {

/// Entries with different values, as "gear.ratio is 19 there, 16 in the file".
struct Differences {
  std::vector<std::string> of_robots, of_numbers;
};

template <class Value>
std::string Differs(const std::string& key, const Value& recorded, const Value& file) {
  return fmt::format("{} is {} there, {} in the file", key, recorded, file);
}

/// The largest factor by which an effect of the library changes a section's length.
double MostLengthFactor() {
  const sim::EffectParameter& scale =
      sim::FindEffectOfNumber("body.sections.unit_length_m")->parameters.front();
  return std::max(scale.upper, 1 / scale.lower);
}

double LengthOf(const SectionParameters& section) { return section.units * section.unit_length_m; }

void CompareBodies(const BodyParameters& recorded, const BodyParameters& file, Differences& all) {
  constexpr double kDigits = 1e-9;  // of numbers that were written and read again
  if (recorded.sections.size() != file.sections.size()) {
    all.of_robots.push_back(
        Differs("number of body.sections", recorded.sections.size(), file.sections.size()));
    return;
  }
  for (std::size_t k = 0; k < file.sections.size(); ++k) {
    const SectionParameters &its = recorded.sections[k], &ours = file.sections[k];
    const std::string section = fmt::format("body.sections[{}]", k);
    if (its.tendons.size() != ours.tendons.size()) {
      all.of_robots.push_back(
          Differs("number of " + section + ".tendons", its.tendons.size(), ours.tendons.size()));
    }
    const double its_m = LengthOf(its), ours_m = LengthOf(ours);
    const double factor = std::max(its_m / ours_m, ours_m / its_m);
    if (factor <= 1 + kDigits) continue;
    const std::string text = Differs("length (units x unit_length_m) of " + section,
                                     fmt::format("{:.4g} m", its_m), fmt::format("{:.4g} m", ours_m));
    (factor > MostLengthFactor() * (1 + kDigits) ? all.of_robots : all.of_numbers).push_back(text);
  }
}

void CompareDrives(const ActuationParameters& recorded, const ActuationParameters& file, Differences& all) {
  const std::size_t tendons = std::min(recorded.tendons.size(), file.tendons.size());
  const auto compare = [&](const char* key, std::vector<std::string>& into, auto&& value) {
    for (std::size_t j = 0; j < tendons; ++j) {
      const auto its = value(recorded.tendons[j]), ours = value(file.tendons[j]);
      if (its == ours) continue;
      into.push_back(Differs(fmt::format("actuation.{} (tendon {})", key, j + 1), its, ours));
      return;
    }
  };
  compare("drive.encoder_counts_per_turn", all.of_robots,
          [](const TendonDriveParameters& t) { return t.drive.encoder_counts_per_turn; });
  compare("drive.rated_torque_Nm", all.of_numbers,
          [](const TendonDriveParameters& t) { return t.drive.rated_torque_Nm; });
  compare("gear.ratio", all.of_numbers, [](const TendonDriveParameters& t) { return t.gear.ratio; });
  compare("spool.radius_m", all.of_numbers, [](const TendonDriveParameters& t) { return t.spool.radius_m; });
}

Differences Compare(const RobotParameters& recorded, const RobotParameters& file) {
  Differences all;
  if (recorded.name != file.name)
    all.of_robots.push_back(Differs("name", Printable(recorded.name), Printable(file.name)));
  CompareBodies(recorded.body, file.body, all);
  if (recorded.actuation && file.actuation) CompareDrives(*recorded.actuation, *file.actuation, all);
  return all;
}

}  // namespace

RobotOfSet::RobotOfSet(const RobotParameters& robot, std::string file, OtherRobot other)
    : robot_(robot), file_(std::move(file)), other_(other) {}

void RobotOfSet::Check(const RobotParameters& recorded, const std::string& where,
                       std::vector<std::string>& notes) const {
  const Differences found = Compare(sim::FoldEffects(recorded), sim::FoldEffects(robot_));
  if (!found.of_robots.empty() && other_ == OtherRobot::kRefused) {
    throw OtherRobotError(
        fmt::format("{}: these runs are of another robot than {}: {}; accepted: the file of the robot that "
                    "was measured or a corrected one (same name, tendons and encoder counts, each section "
                    "longer or shorter by a factor of at most {:.4g}); if it is the same robot and the "
                    "entries were wrong, say so by --same-robot",
                    where, file_, fmt::join(found.of_robots, ", "), MostLengthFactor()));
  }
  std::vector<std::string> others = found.of_robots;
  others.insert(others.end(), found.of_numbers.begin(), found.of_numbers.end());
  if (others.empty()) return;
  const std::string list = fmt::format("{}", fmt::join(others, ", "));
  // Logs of one robot all differ in the same way.
  if (std::any_of(notes.begin(), notes.end(), [&](const auto& n) { return n.find(list) != n.npos; })) return;
  notes.push_back(
      fmt::format("{} differs from {}, which is taken as the corrected file of the same robot: {}; if it is "
                  "another robot, the difference looks like a gap",
                  where, file_, list));
}

void RobotOfSet::Check(const std::string& recorded_yaml, const std::string& where,
                       std::vector<std::string>& notes) const {
  if (recorded_yaml.empty()) return;
  RobotParameters recorded;
  try {
    recorded = sim::FoldEffects(config::ParseRobot(recorded_yaml, where));
  } catch (const std::exception& e) {
    notes.push_back(
        fmt::format("{}: the file of the robot that it was recorded with cannot be read, so it is not "
                    "compared with {}: {}",
                    where, file_, e.what()));
    return;
  }
  Check(recorded, where, notes);
}

}  // namespace tendril::gap
