// One line: stage, share, elapsed and estimated remaining time. Knows nothing of the work.
#include "progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tendril::tools {
namespace {

constexpr double kQuiet_s = 1, kRedraw_s = 0.1, kLine_s = 5;

std::string Duration(double seconds) {
  const auto whole = static_cast<long>(std::lround(std::max(0.0, seconds)));
  return whole < 60 ? fmt::format("{} s", whole) : fmt::format("{} min {:02} s", whole / 60, whole % 60);
}

}  // namespace

Progress::Progress(std::FILE* out)
    : Progress(out, isatty(fileno(out)) != 0, [] {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
      }) {}

Progress::Progress(std::FILE* out, bool terminal, Clock clock)
    : out_(out), terminal_(terminal), clock_(std::move(clock)), start_s_(clock_()) {
  stage_start_s_ = shown_s_ = start_s_;
}

Progress::~Progress() { Finish(); }

void Progress::operator()(const std::string& stage, double share) {
  const std::lock_guard lock(mutex_);
  const double now_s = clock_();
  if (stage != stage_) {
    EndStage(now_s);
    stage_ = stage;
    share_ = 0;
    stage_start_s_ = now_s;
  }
  share_ = std::clamp(std::isfinite(share) ? share : 0.0, share_, 1.0);
  if (now_s - start_s_ < kQuiet_s || now_s - shown_s_ < (terminal_ ? kRedraw_s : kLine_s)) return;
  Show(now_s, false);
}

void Progress::Finish() {
  const std::lock_guard lock(mutex_);
  const double now_s = clock_();
  EndStage(now_s);
  const double took_s = now_s - start_s_;
  if (took_s >= kQuiet_s && took_s_.size() > 1) {
    std::fputs(TimeByStage(took_s).c_str(), out_);
    std::fflush(out_);
  }
  took_s_.clear();
}

void Progress::EndStage(double now_s) {
  if (drawn_) Show(now_s, true);
  if (stage_.empty()) return;
  // A stage that work returns to counts once.
  const auto same =
      std::find_if(took_s_.begin(), took_s_.end(), [&](const auto& s) { return s.first == stage_; });
  if (same == took_s_.end()) {
    took_s_.emplace_back(stage_, now_s - stage_start_s_);
  } else {
    same->second += now_s - stage_start_s_;
  }
  stage_.clear();
}

std::string Progress::TimeByStage(double took_s) const {
  constexpr double kShort = 0.01;  // of the whole: not listed
  std::string line = fmt::format("  {:.1f} s:", took_s);
  const char* separator = " ";
  for (const auto& [stage, seconds] : took_s_) {
    if (seconds < kShort * took_s) continue;
    line += fmt::format("{}{} {:.1f} s", separator, stage, seconds);
    separator = ", ";
  }
  return line + "\n";
}

void Progress::Show(double now_s, bool last) {
  const double took_s = now_s - stage_start_s_;
  std::string line =
      fmt::format("  {:<48.48} {:3.0f} %  {:>11}", stage_, 100 * (last ? 1 : share_), Duration(took_s));
  if (!last && share_ > 0.02 && took_s > 2) {
    line += fmt::format(", {} to go", Duration(took_s / share_ * (1 - share_)));
  }
  // Clears the rest of a longer previous line.
  std::fputs(terminal_ ? fmt::format("\r{}\x1b[K{}", line, last ? "\n" : "").c_str() : (line + "\n").c_str(),
             out_);
  std::fflush(out_);
  shown_s_ = now_s;
  // Without a terminal each line is complete, and the end of a stage needs none.
  drawn_ = terminal_ && !last;
}

}  // namespace tendril::tools
