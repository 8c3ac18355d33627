#include "tendril/gap/calibration_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "tendril/core/angle.h"
#include "tendril/core/version.h"
#include "tendril/gap/words.h"

namespace tendril::gap {
namespace {

// A number whose variance the runs reduced by less than this is as uncertain as before.
constexpr double kLearned = 0.2;
// Prior deviations beyond which the file is contradicted, and the correlation beyond which only a combination
// of two numbers is known.
constexpr double kContradicts = 3, kTogether = 0.9;

std::string Deviation(const CalibratedNumber& c, double deviation) {
  if (!c.additive) return fmt::format("{:.2g} %", 100 * deviation);
  if (c.unit == "rad") return fmt::format("{:.2g}°", deviation * kDegreesPerRadian);
  return WithUnit(deviation, c.unit);
}

std::string Row(const CalibratedNumber& c) {
  return fmt::format("  {:<52}  {:>10.5g} -> {:>10.5g} {:<8} [{:.5g}, {:.5g}]  ({} -> {})\n", c.key,
                     c.in_file, c.value, c.unit, c.low, c.high, Deviation(c, c.prior),
                     Deviation(c, c.deviation));
}

/// Numbers that the file got wrong by more than it allows.
std::string Contradictions(const Calibration& calibration) {
  std::string text;
  for (const CalibratedNumber& c : calibration.numbers) {
    if (!c.of_file || !(std::abs(c.Moved()) > kContradicts)) continue;
    text += fmt::format(
        "  {}: {:.5g} fits the runs and the file has {:.5g}, {:.2g} times its uncertainty away: "
        "measure it on the robot\n",
        c.key, c.value, c.in_file, std::abs(c.Moved()));
  }
  return text;
}

std::string Together(const Calibration& calibration) {
  std::string text;
  for (std::size_t a = 0; a < calibration.numbers.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) {
      const double r = calibration.correlation(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
      if (std::abs(r) > kTogether) {
        text +=
            fmt::format("  {} and {} ({:+.2f})\n", calibration.numbers[b].key, calibration.numbers[a].key, r);
      }
    }
  }
  return text;
}

std::string Channels(const Calibration& calibration) {
  std::string text;
  for (const CalibratedChannel& c : calibration.channels) {
    text += fmt::format("  {:<34}  {:>9} -> {:>9}  (noise {}, model {})\n", c.name,
                        WithUnit(c.in_file, c.unit), WithUnit(c.held_out, c.unit), WithUnit(c.floor, c.unit),
                        c.discrepancy > 0 ? WithUnit(c.discrepancy, c.unit) : "none seen");
  }
  return text;
}

}  // namespace

std::string CalibrationText(const Calibration& calibration) {
  std::string learned, not_said;
  for (const CalibratedNumber& c : calibration.numbers) {
    if (c.Learned() >= kLearned) {
      learned += Row(c);
    } else {
      not_said += fmt::format("{}{}", not_said.empty() ? "" : ", ", c.key);
    }
  }
  std::string text;
  const auto part = [&](const char* title, const std::string& lines) {
    if (!lines.empty()) text += fmt::format("\n{}\n{}", title, lines);
  };
  part("The runs contradict the file", Contradictions(calibration));
  part("Numbers learned (file -> runs, 95 % interval; uncertainty before -> after)", learned);
  if (!not_said.empty()) part("Not told by these runs, as uncertain as before", "  " + not_said + "\n");
  part("Known only together (correlation)", Together(calibration));
  part(fmt::format("Left of the runs, rms (file -> predicted on held-out {})", calibration.held_out_by)
           .c_str(),
       Channels(calibration));
  std::string notes;
  if (!calibration.converged)
    notes += fmt::format("  not converged after {} steps: calibrate the new file once more\n",
                         calibration.iterations);
  if (!calibration.not_learned.empty()) notes += "  " + calibration.not_learned + "\n";
  for (const std::string& note : calibration.notes) notes += "  " + note + "\n";
  part("Notes", notes);
  return text;
}

std::vector<std::string> CalibrationHeading(const Calibration& calibration) {
  int learned = 0, of_file = 0;
  for (const CalibratedNumber& c : calibration.numbers) {
    of_file += c.of_file;
    learned += c.of_file && c.Learned() >= kLearned;
  }
  return {
      fmt::format("Calibrated by `tendril gap calibrate` ({}): {} of {} uncertain numbers learned from runs.",
                  Version(), learned, of_file)};
}

std::string CalibrationJson(const Calibration& calibration) {
  using Json = nlohmann::ordered_json;
  Json json{{"format", 1},
            {"version", std::string(Version())},
            {"robot", calibration.robot.name},
            {"converged", calibration.converged},
            {"not_learned", calibration.not_learned},
            {"iterations", calibration.iterations},
            {"held_out_by", calibration.held_out_by}};
  for (const CalibratedNumber& c : calibration.numbers) {
    json["numbers"].push_back({{"key", c.key},
                               {"unit", c.unit},
                               {"deviations_are", c.additive ? c.unit : "share"},
                               {"of_file", c.of_file},
                               {"in_file", c.in_file},
                               {"value", c.value},
                               {"low", c.low},
                               {"high", c.high},
                               {"prior_deviation", c.prior},
                               {"deviation", c.deviation},
                               {"learned", c.Learned()},
                               {"moved", c.Moved()}});
  }
  for (Eigen::Index a = 0; a < calibration.correlation.rows(); ++a) {
    const Eigen::VectorXd row = calibration.correlation.row(a);
    json["correlation"].push_back(std::vector<double>(row.begin(), row.end()));
  }
  for (const CalibratedChannel& c : calibration.channels) {
    json["channels"].push_back({{"name", c.name},
                                {"unit", c.unit},
                                {"in_file", c.in_file},
                                {"held_out", c.held_out},
                                {"floor", c.floor},
                                {"discrepancy", c.discrepancy}});
  }
  json["known"] = calibration.known;
  json["notes"] = calibration.notes;
  return json.dump(2) + "\n";
}

}  // namespace tendril::gap
