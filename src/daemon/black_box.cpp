// The ring of cycles and its log; see the header.
#include "tendril/daemon/black_box.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <functional>
#include <regex>
#include <span>
#include <stdexcept>
#include <string_view>
#include <system_error>

namespace tendril::daemon {
namespace {

namespace fs = std::filesystem;

// One block more than the configured time, because the oldest is being overwritten.
constexpr std::size_t kBlocks = 11;

std::size_t BlockCycles(double seconds, TimeNs period_ns) {
  const double cycles = seconds * static_cast<double>(kNsPerS) / static_cast<double>(period_ns);
  return static_cast<std::size_t>(std::max(1.0, std::ceil(cycles / (kBlocks - 1))));
}

std::string_view NameOf(Status status) {
  switch (status) {
#define TENDRIL_STATUS_NAME(name, number, text, remedy) \
  case Status::k##name:                                 \
    return #name;
    TENDRIL_STATUS_LIST(TENDRIL_STATUS_NAME)
#undef TENDRIL_STATUS_NAME
  }
  return "Unknown";
}

// 20260304T050607.089Z: sorts by time and is a valid file name everywhere.
std::string TimeText(std::int64_t utime) {
  return fmt::format("{:%Y%m%dT%H%M%S}.{:03}Z", fmt::gmtime(static_cast<std::time_t>(utime / 1'000'000)),
                     utime / 1000 % 1000);
}

// Keeps the newest of the black box logs in the folder, recognised by their names.
void RemoveOldest(const fs::path& folder) {
  static const std::regex name(R"(\d{8}T\d{6}\.\d{3}Z_4\d\d_\w+\.lcmlog)");
  std::vector<fs::path> logs;
  std::error_code error;
  for (fs::directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
    if (std::regex_match(i->path().filename().string(), name)) logs.push_back(i->path());
  }
  if (logs.size() <= BlackBox::kLogsKept) return;
  std::sort(logs.begin(), logs.end(), std::greater<>());  // by time
  for (std::size_t i = BlackBox::kLogsKept; i < logs.size(); ++i) fs::remove(logs[i], error);
}

}  // namespace

BlackBox::BlackBox(const BlackBoxParameters& parameters, const LcmParameters& lcm,
                   const io::RobotShape& shape, const io::RunInfo& run, std::int64_t epoch_offset_us,
                   TimeNs period_ns, const control::Controller& controller)
    : parameters_(parameters),
      channel_prefix_(lcm.channel_prefix),
      shape_(shape),
      run_(run),
      epoch_offset_us_(epoch_offset_us),
      block_cycles_(BlockCycles(parameters.seconds, period_ns)),
      state_bytes_(controller.state_bytes()),
      records_(kBlocks * block_cycles_),
      snapshots_(kBlocks),
      states_(kBlocks * state_bytes_) {
  SaveState(0, 0, controller);
}

std::string BlackBox::CheckFolder() const {
  std::error_code error;
  fs::create_directories(parameters_.folder, error);
  if (!error && access(parameters_.folder.c_str(), W_OK | X_OK) != 0) {
    error = std::error_code(errno, std::generic_category());
  }
  if (!error) return {};
  return fmt::format(
      "{}: {}; faults will leave no black box: give a folder that this user may write to "
      "(black_box.folder or --black-box)",
      parameters_.folder, error.message());
}

void BlackBox::SaveState(std::uint64_t next_cycle, TimeNs time_ns,
                         const control::Controller& controller) noexcept {
  const std::size_t block = count_ / block_cycles_ % kBlocks;
  snapshots_[block] = {next_cycle, time_ns};
  controller.SaveState({state_of(block), state_bytes_});
}

void BlackBox::Add(const CycleRecord& record, const control::Controller& controller) noexcept {
  const bool faulted = record.output.mode == Mode::kFault && last_mode_ != Mode::kFault;
  last_mode_ = record.output.mode;
  const Phase phase = phase_.load(std::memory_order_acquire);
  if (phase == Phase::kFull) return;
  const std::uint64_t next_cycle = record.input.cycle + 1;
  const TimeNs time_ns = record.input.time_ns;
  if (phase == Phase::kWritten) {
    // Recording restarts with the next cycle.
    count_ = 0;
    SaveState(next_cycle, time_ns, controller);
    phase_.store(Phase::kRecording, std::memory_order_relaxed);
    return;
  }
  records_[count_ % records_.size()] = record;
  ++count_;
  if (faulted) {
    phase_.store(Phase::kFull, std::memory_order_release);
  } else if (count_ % block_cycles_ == 0) {
    SaveState(next_cycle, time_ns, controller);
  }
}

void BlackBox::Begin() {
  const std::size_t block = (count_ - 1) / block_cycles_;  // the one written to last
  const std::size_t first_block = block + 1 < kBlocks ? 0 : block + 1 - kBlocks;
  first_ = next_ = first_block * block_cycles_;
  const CycleRecord& last = records_[(count_ - 1) % records_.size()];
  const Status status = last.output.status;
  cause_ = fmt::format("{} {}", static_cast<int>(status), NameOf(status));
  const std::int64_t utime = last.input.time_ns / kNsPerUs + epoch_offset_us_;
  path_ = (fs::path(parameters_.folder) /
           fmt::format("{}_{}_{}.lcmlog", TimeText(utime), static_cast<int>(status), NameOf(status)))
              .string();
  std::error_code error;
  fs::create_directories(parameters_.folder, error);  // an error shows when the file is opened
  // It has another name until it is complete.
  log_ = std::make_unique<io::RecordLog>(path_ + ".part", shape_, channel_prefix_, epoch_offset_us_);
  const std::size_t slot = first_block % kBlocks;
  const Snapshot& snapshot = snapshots_[slot];
  log_->Run(run_, snapshot.time_ns);
  log_->Snapshot(snapshot.next_cycle, snapshot.time_ns, {state_of(slot), state_bytes_});
}

std::optional<BlackBox::Outcome> BlackBox::WriteSome(int cycles) {
  if (!full()) return std::nullopt;
  std::string problem;
  try {
    if (!log_) Begin();
    for (int i = 0; i < cycles && next_ < count_; ++i) log_->Cycle(records_[next_++ % records_.size()]);
    if (next_ < count_) return std::nullopt;
    problem = log_->Close();
    if (problem.empty()) {
      fs::rename(path_ + ".part", path_);
      RemoveOldest(parameters_.folder);
    }
  } catch (const std::exception& e) {
    problem = e.what();
  }
  log_.reset();
  const std::size_t written = count_ - first_;
  phase_.store(Phase::kWritten, std::memory_order_release);
  if (problem.empty()) {
    return Outcome{Status::kOk, fmt::format("{} cycles before fault {}: {}", written, cause_, path_)};
  }
  std::error_code ignored;
  fs::remove(path_ + ".part", ignored);
  return Outcome{
      Status::kDegraded,
      fmt::format(
          "the cycles before fault {} could not be written and are lost: {} ({}); check that this user "
          "may write to black_box.folder and the space on its disk; control continues",
          cause_, problem, path_)};
}

}  // namespace tendril::daemon
