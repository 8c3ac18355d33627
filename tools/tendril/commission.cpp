// `tendril commission`: is the robot on a running daemon wired as its files say? Pulls one motor at a time at
// low torque, prints what was found with what to change, and leaves the record that tendrild arms by. Most of
// it is the dialogue at the terminal.
#include "tendril/commission/commission.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <numbers>
#include <stdexcept>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/commission/findings_file.h"
#include "tendril/commission/live_link.h"
#include "tendril/commission/same_files.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/clock.h"
#include "tendril/daemon/commissioning.h"

namespace tendril::tools {
namespace {

constexpr TimeNs kAnswer_ns = 120 * kNsPerS;

std::atomic<bool> stop = false;

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
bool MayBegin() {
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

void RunCommission(const CommissionOptions& options) {
  const DaemonParameters daemon = config::LoadDaemon(options.config);
  const RobotParameters robot = config::LoadRobot(daemon.robot_file);
  config::CheckTogether(daemon, robot, options.config);
  commission::RequireRecordAsked(daemon, options.config);
  const auto tendons = static_cast<std::size_t>(robot.body.tendons());
  if (!options.seen_deg.empty() && options.seen_deg.size() != tendons) {
    throw UsageError(fmt::format("--seen needs a direction for each of the {} tendons, {} given", tendons,
                                 options.seen_deg.size()));
  }
  // Before motors pull for half a minute, not after.
  const std::string path = daemon::RecordPath(daemon);
  config::CheckMayWrite(path);
  if (options.write) {
    config::CheckMayWrite(options.config);
    config::CheckMayWrite(daemon.robot_file);
  }
  commission::CommissionResult result;
  commission::DriveSerials serials;
  {
    commission::LiveLink link(options.lcm.empty() ? daemon.lcm.url : options.lcm,
                              options.prefix.empty() ? daemon.lcm.channel_prefix : options.prefix, &stop);
    commission::RequireSameFiles({link.Robot(), link.Daemon()}, {robot, daemon}, options.config);
    if (!options.yes && isatty(STDIN_FILENO) == 0)
      throw UsageError(
          "no terminal for the confirmation before motors pull; accepted: --yes, to begin without it");
    fmt::print("pulls one motor at a time with at most {:g} N of tendon; keep the power switch in reach\n",
               daemon.controller.take_up.pull_N);
    if (!options.yes && !MayBegin()) {
      throw std::runtime_error("cancelled before any motor pulled");
    }
    link.Enter(robot.body.tendons());
    const commission::AskDirection ask =
        [&](int tendon, const std::function<void()>& keep_going) -> std::optional<double> {
      if (!options.seen_deg.empty())
        return options.seen_deg[static_cast<std::size_t>(tendon - 1)] * std::numbers::pi / 180;
      if (isatty(STDIN_FILENO) == 0) return std::nullopt;
      return AskTerminal(tendon, keep_going);
    };
    result = commission::Commission(link, robot, daemon, ask,
                                    [](const std::string& line) { fmt::print(stderr, "{}\n", line); });
    serials = link.serials();
  }
  fmt::print("\n{}", commission::CommissionTable(result));
  if (!result.passed()) {
    if (options.write) {
      commission::WriteFindings(result, options.config, daemon.robot_file,
                                [](const std::string& text) { fmt::print("{}", text); });
      fmt::print(
          "\nwritten; restart tendrild, which reads its files once, and commission again: nothing is armed "
          "before that passes\n");
    }
    throw std::runtime_error(options.write ? "not commissioned yet"
                                           : "not commissioned: correct the problems above (or let --write "
                                             "change the files where that is enough), and commission again");
  }
  daemon::WriteRecord(path, commission::RecordOf(result, robot, daemon, serials));
  fmt::print("\ncommissioned: {}; `tendril home` takes up slack, `tendril send arm` arms\n", path);
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
  command
      ->add_option(
          "--seen", options->seen_deg,
          "without a tracker: where the tip bends to under each tendon, in tendon order [deg from the base's "
          "+x towards +y]")
      ->expected(1, kMaxTendons)
      ->check(NumberFrom(-360, 360, "give degrees"));
  command->add_flag(
      "--write", options->write,
      "write the nodes and directions found into FILE, and the cells' zeros into the robot file");
  command->add_flag("--yes", options->yes, "begin without asking; needed where no terminal is");
  command->callback([options] {
    std::signal(SIGINT, [](int) { stop = true; });
    std::signal(SIGTERM, [](int) { stop = true; });
    RunCommission(*options);
  });
}

}  // namespace tendril::tools
