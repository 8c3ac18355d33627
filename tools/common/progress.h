// Shows the progress of long work: on a terminal one line that is redrawn, elsewhere a line from time to
// time. Knows nothing of the work.
#pragma once

#include <chrono>
#include <cstdio>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace tendril::tools {

/// May be called from several threads. Work that ends within a second shows nothing.
class Progress {
 public:
  using Clock = std::function<double()>;  // seconds, monotonic
  /// `terminal`: whether `out` can redraw a line. Errors of `out` are ignored, so that progress never ends
  /// the work.
  explicit Progress(std::FILE* out = stderr);
  Progress(std::FILE* out, bool terminal, Clock clock);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// The stage and its completed share, 0 to 1; a decreasing share is not shown.
  void operator()(const std::string& stage, double share);
  /// Ends the line and writes the time by stage, if there were several; called by the destructor as well.
  void Finish();

 private:
  void Show(double now_s, bool last);
  void EndStage(double now_s);
  std::string TimeByStage(double took_s) const;

  std::FILE* out_;
  bool terminal_;
  Clock clock_;
  std::mutex mutex_;
  std::string stage_;
  double share_ = 0;
  double start_s_ = 0, stage_start_s_ = 0, shown_s_ = 0;
  bool drawn_ = false;                                  // this stage is on the terminal's line
  std::vector<std::pair<std::string, double>> took_s_;  // the stages that ended, in order
};

}  // namespace tendril::tools
