#include "systemd.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <syslog.h>
#include <systemd/sd-daemon.h>
#include <systemd/sd-journal.h>

#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <mutex>
#include <stop_token>
#include <string>
#include <utility>

namespace tendril::daemon {
namespace {

spdlog::level::level_enum LevelOf(Status status) {
  if (IsFault(status)) return spdlog::level::err;
  return status == Status::kOk ? spdlog::level::info : spdlog::level::warn;
}

}  // namespace

void WriteLogLine(const Message& m) {
  static const bool journal = std::getenv("JOURNAL_STREAM") != nullptr;
  const spdlog::level::level_enum level = LevelOf(m.status);
  if (!journal) {
    spdlog::default_logger()->log(m.at, {}, level, fmt::format("{}: {}", m.source, m.text));
    return;
  }
  const int priority = level == spdlog::level::err    ? LOG_ERR
                       : level == spdlog::level::warn ? LOG_WARNING
                                                      : LOG_INFO;
  sd_journal_send("MESSAGE=%s: %s", m.source.c_str(), m.text.c_str(), "PRIORITY=%i", priority,
                  "TENDRIL_SOURCE=%s", m.source.c_str(), "TENDRIL_STATUS=%i", static_cast<int>(m.status),
                  "TENDRIL_REMEDY=%s", std::string(StatusRemedy(m.status)).c_str(), nullptr);
}

WatchdogFeeder::WatchdogFeeder(const std::atomic<std::uint64_t>& tick) {
  std::uint64_t within_us = 0;
  if (sd_watchdog_enabled(0, &within_us) <= 0) return;
  thread_ =
      std::jthread([&tick, every = std::chrono::microseconds(within_us / 4)](const std::stop_token& stop) {
        std::mutex mutex;
        std::unique_lock lock(mutex);
        std::condition_variable_any ended;
        std::uint64_t seen = 0;
        while (!ended.wait_for(lock, stop, every, [&stop] { return stop.stop_requested(); })) {
          const std::uint64_t now = tick.load(std::memory_order_relaxed);
          if (now != std::exchange(seen, now)) sd_notify(0, "WATCHDOG=1");
        }
      });
}

}  // namespace tendril::daemon
