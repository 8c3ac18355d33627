#include "tendril/gap/found_effects.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "file_numbers.h"
#include "tendril/core/version.h"

namespace tendril::gap {
namespace {

// A value without digits that its interval does not know: what is rounded off is a hundredth of it at most.
double Sensible(const Estimate& e) {
  const double width = e.high - e.low;
  if (!(width > 0) || !std::isfinite(width) || !std::isfinite(e.value)) return e.value;
  const int digits = std::clamp(-static_cast<int>(std::floor(std::log10(width / 50))), -15, 15);
  const double rounded = std::stod(fmt::format("{:.{}f}", e.value, std::max(0, digits)));
  return rounded >= e.low && rounded <= e.high ? rounded : e.value;
}

}  // namespace

std::vector<EffectSetting> FoundEffects(const Diagnosis& diagnosis) {
  std::vector<EffectSetting> effects;
  for (const Cause& cause : diagnosis.accepted) {
    EffectSetting setting{.name = cause.effect, .where = cause.where, .values = {}};
    for (const auto& [name, value] : cause.parameters) setting.values.emplace_back(name, Sensible(value));
    effects.push_back(setting);
  }
  return effects;
}

RobotParameters WithLearnedNumbers(const RobotParameters& file, const Diagnosis& diagnosis) {
  RobotParameters robot = file;
  for (const FileNumber& number : FileNumbers(file)) {
    const auto learned = std::find_if(diagnosis.learned.begin(), diagnosis.learned.end(),
                                      [&](const LearnedNumber& n) { return n.key == number.key; });
    if (learned != diagnosis.learned.end()) number.apply(robot, number.ChangeTo(learned->value));
  }
  return robot;
}

std::vector<std::string> Provenance(const Diagnosis& d, const std::string& report) {
  std::vector<std::string> lines{
      fmt::format("Patched by `tendril gap apply` ({}) from {}:", Version(), report)};
  lines.push_back(fmt::format("verdict {}, of robot '{}', diagnosed by {} {}", VerdictName(d.verdict),
                              d.robot_name, d.version, d.revision));
  for (const Cause& cause : d.accepted) {
    std::string line = fmt::format("{} {} (p = {:.3g})", cause.effect, cause.where, cause.p);
    for (const auto& [name, value] : cause.parameters)
      line += fmt::format(", {} {:.4g} [{:.4g}, {:.4g}]", name, value.value, value.low, value.high);
    lines.push_back(line);
  }
  for (const LearnedNumber& n : d.learned)
    lines.push_back(fmt::format("learned {}: {:.6g}, was {:.6g}", n.key, n.value, n.in_file));
  if (d.closed) {
    lines.push_back(fmt::format("closes {:.1f} % [{:.1f}, {:.1f}] of the gap on held-out runs",
                                100 * d.closed->value, 100 * d.closed->low, 100 * d.closed->high));
  }
  for (const RunSummary& run : d.runs) lines.push_back(fmt::format("log {} sha256 {}", run.name, run.sha256));
  // A comment is one line, whatever a log was called.
  for (std::string& line : lines) {
    for (char& c : line) {
      if (static_cast<unsigned char>(c) < ' ') c = ' ';
    }
  }
  return lines;
}

}  // namespace tendril::gap
