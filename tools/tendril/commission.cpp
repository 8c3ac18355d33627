// `tendril commission`: is the robot on a running daemon wired as its files say? Pulls one motor at a time at
// low torque, prints what was found with what to change, and leaves the record that tendrild arms by. Most of
// it is the dialogue at the terminal.
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <numbers>
#include <optional>
#include <stdexcept>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "stop_signals.h"
#include "tendril/commission/session.h"
#include "tendril/core/clock.h"
#include "tendril/core/limits.h"

namespace tendril::tools {
namespace {

constexpr TimeNs kAnswer_ns = 120 * kNsPerS;

struct CommissionOptions {
  std::string config, lcm, prefix;
  std::vector<double> seen_deg;
  bool write = false, yes = false;
};

bool LineWaits(int timeout_ms) {
  pollfd in{.fd = STDIN_FILENO, .events = POLLIN, .revents = 0};
  return poll(&in, 1, timeout_ms) > 0;
}

// Enter, and not Ctrl-C or the end of the input.
bool MayBegin(const std::atomic<bool>& stop) {
  fmt::print("Enter to begin, Ctrl-C to cancel: ");
  std::fflush(stdout);
  while (!stop && !LineWaits(100)) {
  }
  std::string line;
  return !stop && std::getline(std::cin, line);
}

// A line of the terminal, while the pull is kept up.
std::optional<double> AskTerminal(int tendon, const std::function<void()>& keep_going) {
  fmt::print(
      "tendon {} pulls now: which way is the tip bent, seen along the base frame? [deg from +x towards +y, "
      "Enter: cannot tell] ",
      tendon);
  std::fflush(stdout);
  const MonotonicClock clock;
  const TimeNs end_ns = clock.Now() + kAnswer_ns;
  while (!LineWaits(0)) {
    keep_going();
    if (clock.Now() > end_ns) throw std::runtime_error("no answer: no motor pulls unattended");
  }
  std::string line;
  std::getline(std::cin, line);
  if (line.find_first_not_of(" \t\r") == std::string::npos) return std::nullopt;
  char* end = nullptr;
  const double deg = std::strtod(line.c_str(), &end);
  if (std::isfinite(deg) && end != line.c_str() &&
      std::string_view(end).find_first_not_of(" \t\r") == std::string_view::npos)
    return deg * std::numbers::pi / 180;
  fmt::print("'{}' is not an angle; give degrees such as 120, or Enter\n", line);
  return AskTerminal(tendon, keep_going);
}

void Consent(bool asked, double pull_N, const std::atomic<bool>& stop) {
  if (asked && isatty(STDIN_FILENO) == 0)
    throw UsageError(
        "no terminal for the confirmation before motors pull; accepted: --yes, to begin without it");
  fmt::print("pulls one motor at a time with at most {:g} N of tendon; keep the power switch in reach\n",
             pull_N);
  if (asked && !MayBegin(stop)) throw std::runtime_error("cancelled before any motor pulled");
}

void RunCommission(const CommissionOptions& options) {
  const std::atomic<bool>& stop = CatchStopSignals();
  commission::SessionCall call{.config = options.config,
                               .lcm_url = options.lcm,
                               .channel_prefix = options.prefix,
                               .write = options.write,
                               .stop = &stop};
  for (const double deg : options.seen_deg) call.seen_rad.push_back(deg * std::numbers::pi / 180);
  const std::string record = commission::RunSession(
      call, {.consent = [&](double pull_N) { Consent(!options.yes, pull_N, stop); },
             .direction = [](int tendon, const std::function<void()>& keep_going) -> std::optional<double> {
               if (isatty(STDIN_FILENO) == 0) return std::nullopt;
               return AskTerminal(tendon, keep_going);
             },
             .progress = [](const std::string& line) { fmt::print(stderr, "{}\n", line); },
             .tell = [](const std::string& text) { fmt::print("{}", text); }});
  fmt::print("\ncommissioned: {}; `tendril home` takes up slack, `tendril send arm` arms\n", record);
}

}  // namespace

void AddCommissionCommand(CLI::App& app) {
  auto options = std::make_shared<CommissionOptions>();
  CLI::App* command = app.add_subcommand(
      "commission", "Check that a robot is wired as its files say, and write the record needed for arming");
  command->add_option("--config", options->config, "the file that the daemon runs with")
      ->required()
      ->option_text("FILE");
  command->add_option("--lcm", options->lcm, "LCM address (default: the file's lcm.url)")->check(LcmUrl());
  command->add_option("--prefix", options->prefix, "of channels (default: the file's lcm.channel_prefix)")
      ->check(ChannelPrefix());
  AddKeyOption(*command);
  command
      ->add_option("--seen", options->seen_deg,
                   "without a tracker: where the tip bends to under each motor's tendon, in tendon order, of "
                   "a pair its "
                   "first [deg from the base's +x towards +y]")
      ->expected(1, kMaxTendons)
      ->check(NumberFrom(-360, 360, "give degrees"));
  command->add_flag(
      "--write", options->write,
      "write the nodes and directions found into FILE, and the cells' zeros into the robot file");
  command->add_flag("--yes", options->yes, "begin without asking; needed where no terminal is");
  command->callback([options] { RunCommission(*options); });
}

}  // namespace tendril::tools
