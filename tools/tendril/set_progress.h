// One line a finished run, and on a terminal a line that moves: how a set of experiments gets on, and where
// it is left. Knows nothing of how runs are made.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "counted.h"
#include "set_folder.h"
#include "tendril/experiment/experiment_run.h"

namespace tendril::tools {

class SetProgressLine {
 public:
  explicit SetProgressLine(std::vector<experiment::NamedRun> runs)
      : runs_(std::move(runs)), terminal_(isatty(STDERR_FILENO)) {}

  void Show(std::size_t run, double share, const experiment::Experiment* done) {
    if (done) {
      going_.erase(run);
      const auto& t = done->run.time_s;
      Put(fmt::format("{}{:<20} {:6.1f} s, tensions to {:.1f} N{}\n", terminal_ ? "\r\033[K" : "",
                      runs_[run].name, t.size() ? t.tail(1)[0] : 0.0, done->largest_tension_N,
                      done->trouble.empty() ? "" : "; ended early"));
    } else {
      going_[run] = share;
    }
    if (!terminal_) return;
    std::string line = "\r\033[K";
    for (const auto& [which, part] : going_)
      line += fmt::format("{} {:3.0f} %  ", runs_[which].name, 100 * part);
    Put(line);
  }

 private:
  // Whatever becomes of it: showing progress must not end the run.
  static void Put(const std::string& text) { std::fputs(text.c_str(), stderr); }

  std::vector<experiment::NamedRun> runs_;
  bool terminal_;
  std::map<std::size_t, double> going_;
};

/// What the runs of a plan will be called.
inline std::vector<std::string> FileNames(const experiment::Plan& plan) {
  std::vector<std::string> names;
  for (const experiment::NamedRun& run : experiment::NameRuns(plan)) names.push_back(run.name);
  return names;
}

/// Leaves a set in its folder and returns where. An earlier set gives way to a complete one only; what was
/// `measured` so far then goes beside it. Throws std::runtime_error where nothing is left.
inline std::filesystem::path WriteSet(const experiment::ExperimentSet& set, const SetFolder& folder,
                                      bool measured) {
  if (set.data.runs.empty()) throw std::runtime_error("nothing was recorded: " + set.trouble);
  if (set.trouble.empty()) {
    folder.Write(set.data);
    return folder.path();
  }
  if (folder.replaces() && !measured) {
    throw std::runtime_error(fmt::format("the set is not complete: {}; {} still holds the earlier one",
                                         set.trouble, folder.path().string()));
  }
  return folder.WriteIncomplete(set.data);
}

}  // namespace tendril::tools
