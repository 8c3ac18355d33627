#include "readable.h"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>

#include "comparable.h"
#include "implausible.h"
#include "measured_wrong.h"
#include "own_readings.h"
#include "tendril/sim/effects.h"

namespace tendril::gap {

ReadableSet Readable(const DataSet& given, std::vector<std::string>& notes) {
  const auto note = [&](const std::vector<std::string>& lines) {
    notes.insert(notes.end(), lines.begin(), lines.end());
  };
  DataSet set = given;
  // The robot file's own list of effects is part of the model; changing it again would list an effect twice.
  set.robot = sim::FoldEffects(given.robot);
  RequireTendons(set);
  note(LeaveOutShortRuns(set));
  note(LeaveOutOtherTimeUnits(set));
  FillMissing(set);
  note(KeepOwnReadings(set));
  Masked masked = MaskImplausible(set);
  note(masked.lines);
  RefuseOtherTime(set);
  return {std::move(set), std::move(masked.contradictions)};
}

void RefuseContradictions(const ReadableSet& set) {
  if (set.contradictions.empty()) return;
  throw std::runtime_error(
      fmt::format("{}: a unit of the runs, or a number of the robot file is wrong; correct it before the "
                  "others are inferred",
                  set.contradictions.front()));
}

}  // namespace tendril::gap
