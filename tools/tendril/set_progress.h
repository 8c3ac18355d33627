// One line a finished run, and on a terminal a line that moves: the progress of a set of experiments. Knows
// nothing of how runs are made.
#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

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

}  // namespace tendril::tools
