#include "neighbour.h"

#include <fmt/format.h>

#include <utility>

namespace tendril::daemon {
namespace {

// Its run record comes once a second.
constexpr TimeNs kGone_ns = 3 * kNsPerS;

}  // namespace

void Neighbour::Heard(const io::RunInfo& run, TimeNs now_ns) {
  if (run.daemon == own_.daemon && run.start_utime == own_.start_utime) return;
  name_ = run.daemon.empty() ? "which does not say where it runs" : run.daemon;
  heard_ns_ = now_ns;
}

std::string Neighbour::Text() const {
  return fmt::format(
      "another daemon ({}) answers on {}_* at {}: both would obey one command; stop one of them, or give "
      "each its own lcm.channel_prefix (or lcm.url)",
      name_, lcm_.channel_prefix, lcm_.url);
}

std::optional<Neighbour::News> Neighbour::NewsAt(TimeNs now_ns) {
  if (!present()) return std::nullopt;
  if (now_ns - heard_ns_ > kGone_ns) {
    told_ = false;
    return News{Status::kOk, fmt::format("the other daemon ({}) is silent: this one may be armed again",
                                         std::exchange(name_, {}))};
  }
  if (std::exchange(told_, true)) return std::nullopt;
  return News{Status::kAnotherDaemon, Text() + "; disarmed, and nothing is armed until then"};
}

}  // namespace tendril::daemon
