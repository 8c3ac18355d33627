// Shows people how far long work is: on a terminal one line that is drawn again, elsewhere a line now and
// then. Knows nothing of the work.
#pragma once

#include <chrono>
#include <cstdio>
#include <functional>
#include <mutex>
#include <string>

namespace tendril::tools {

/// May be called from several threads. Nothing is shown of work that is done within a second.
class Progress {
 public:
  using Clock = std::function<double()>;  // seconds, monotonic
  /// `terminal`: whether `out` can draw a line again. Showing progress never ends the work: errors of `out`
  /// are ignored.
  explicit Progress(std::FILE* out = stderr);
  Progress(std::FILE* out, bool terminal, Clock clock);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// What is being done and which share of it, 0 to 1, is done; a share that falls back is not shown.
  void operator()(const std::string& stage, double share);
  /// Ends the line; called by the destructor as well.
  void Finish();

 private:
  void Show(double now_s, bool last);

  std::FILE* out_;
  bool terminal_;
  Clock clock_;
  std::mutex mutex_;
  std::string stage_;
  double share_ = 0;
  double start_s_ = 0, stage_start_s_ = 0, shown_s_ = 0;
  bool drawn_ = false;  // something of this stage is on the terminal's line
};

}  // namespace tendril::tools
