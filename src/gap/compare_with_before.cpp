// Pairs the runs of a set with runs of the same commands from before the robot changed.
#include <fmt/core.h>

#include <algorithm>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "postures/diagnose_postures.h"
#include "postures/states.h"
#include "tendril/config/config.h"
#include "tendril/gap/data_set.h"
#include "text.h"

namespace tendril::gap {

bool IsBefore(const DataSet& set, const Run& run) {
  return std::any_of(set.runs.begin(), set.runs.end(), [&](const Run& r) { return r.before == run.name; });
}

void CompareWithBefore(DataSet& set, DataSet before) {
  if (const int was = before.robot.body.tendons(), is = set.robot.body.tendons(); was != is) {
    throw std::runtime_error(fmt::format(
        "the runs from before are of robot '{}' with {} tendons, these of '{}' with {}; accepted: "
        "runs of the same robot",
        before.robot.name, was, set.robot.name, is));
  }
  const auto numbers = [](RobotParameters robot) {
    robot.uncertain.clear();  // the same robot, measured better
    return config::ToYaml(robot);
  };
  if (numbers(before.robot) != numbers(set.robot)) {
    set.notes.push_back(
        fmt::format("the runs from before have another robot file ('{}'); that of these runs ('{}') is used "
                    "for both; give --robot to choose",
                    before.robot.name, set.robot.name));
  }
  const auto named = [](const DataSet& data, const std::string& name) -> const Run* {
    const auto run =
        std::find_if(data.runs.begin(), data.runs.end(), [&](const Run& r) { return r.name == name; });
    return run == data.runs.end() ? nullptr : &*run;
  };
  const auto only_of_kind = [](const DataSet& data, const std::string& family) -> const Run* {
    const Run* only = nullptr;
    for (const Run& run : data.runs) {
      if (run.family != family || !run.repeat_of.empty()) continue;
      if (only != nullptr) return nullptr;
      only = &run;
    }
    return only;
  };
  // Where the robot is learned from the runs before, their commands need not be those after.
  before.robot = set.robot;
  const bool learned = CanLearnPostures(before) && ShowsPostures(set);
  if (learned) set.fit_frame = set.fit_frame || before.fit_frame;
  std::string alone;
  std::map<std::string, std::string> partner;
  for (const Run& run : set.runs) {
    const Run* its = named(before, run.name);
    if (its == nullptr && only_of_kind(set, run.family) != nullptr) its = only_of_kind(before, run.family);
    if (its == nullptr && learned) its = &before.runs.front();
    if (its != nullptr) {
      partner.emplace(run.name, its->name);
    } else {
      alone += (alone.empty() ? "" : ", ") + Printable(run.name);
    }
  }
  if (partner.empty()) {
    throw std::runtime_error(
        fmt::format("no run has a counterpart from before ({}); accepted: a run of the same name there, or "
                    "the only one of the same kind ('family' in runs.yaml)",
                    alone));
  }
  if (!alone.empty()) {
    set.notes.push_back("left out, since there is no run of the same name or family from before: " + alone);
    std::erase_if(set.runs, [&](const Run& run) { return !partner.contains(run.name); });
  }

  std::set<std::string> taken;
  for (const Run& run : set.runs) taken.insert(run.name);
  std::map<std::string, std::string> called;  // new names of the earlier runs
  for (const Run& run : before.runs) {
    std::string name = run.name + "@before";
    while (!taken.insert(name).second) name += "'";
    called.emplace(run.name, name);
  }
  for (Run& run : set.runs) run.before = called.at(partner.at(run.name));
  for (Run& run : before.runs) {
    run.name = called.at(run.name);
    run.repeat_of.clear();
    run.before.clear();
    if (learned || IsBefore(set, run)) set.runs.push_back(std::move(run));
  }
  for (const auto& note : before.notes) set.notes.push_back("before: " + note);
}

}  // namespace tendril::gap
