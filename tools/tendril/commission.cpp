// `tendril commission`: is the robot on a running daemon wired as its files say? Pulls one motor at a time at
// low torque, prints what was found with what to change, and leaves the record that tendrild arms by.
#include "tendril/commission/commission.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <lcm/lcm-cpp.hpp>
#include <memory>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "commands.h"
#include "lcm_options.h"
#include "number_option.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"
#include "tendril/core/clock.h"
#include "tendril/io/client.h"
#include "tendril/io/connection.h"
#include "tendril/io/wire.h"
#include "tendril/robot_file/robot_patch.h"
#include "tendril_lcm/statistics_t.hpp"

namespace tendril::tools {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs kValidFor_ns = kNsPerS, kRepeat_ns = 50 * kNsPerMs, kSilence_ns = kNsPerS;
constexpr TimeNs kEnable_ns = 10 * kNsPerS, kAnswer_ns = 120 * kNsPerS;

std::atomic<bool> stop = false;

struct CommissionOptions {
  std::string config, lcm, prefix;
  std::vector<double> seen_deg;
  bool write = false, yes = false;
};

std::int64_t EpochUs() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

// The daemon's cycles over LCM.
class LiveLink final : public CommissionLink {
 public:
  LiveLink(const std::string& url, const std::string& prefix)
      : where_(url + " with prefix " + prefix), lcm_(io::OpenLcm(url)), client_(lcm_.get(), prefix) {
    lcm_->subscribe(io::ChannelName(prefix, "CYCLE"), &LiveLink::TakeCycle, this)->setQueueCapacity(2000);
    lcm_->subscribe(io::ChannelName(prefix, "RUN"), &LiveLink::TakeRun, this);
    client_.OnStatistics([this](const tendril_lcm::statistics_t& s) {
      for (std::size_t i = 0; i < s.drive_node_id.size(); ++i)
        serials_[s.drive_node_id[i]] = static_cast<std::uint32_t>(s.drive_serial[i]);
    });
    const TimeNs end_ns = clock_.Now() + 3 * kNsPerS;
    while (clock_.Now() < end_ns && (cycles_ < 2 || run_.robot_yaml.empty())) io::HandleWaiting(*lcm_, 20);
    if (run_.robot_yaml.empty()) {
      throw std::runtime_error(io::NobodyAnswers(url, prefix, 3, client_));
    }
    // The tracker's readings would fall between those that are published.
    if (const int every = Daemon().lcm.cycle_every_cycles; every != 1 || cycles_ < 2) {
      throw std::runtime_error(
          fmt::format("the daemon on {} publishes {}; commissioning reads every cycle: set "
                      "lcm.cycle_every_cycles to 1 in its file and start it again",
                      where_, every > 1 ? fmt::format("one of {} cycles", every) : std::string("no cycles")));
    }
  }
  ~LiveLink() override { Disarm(); }
  LiveLink(const LiveLink&) = delete;
  LiveLink& operator=(const LiveLink&) = delete;

  RobotParameters Robot() const { return config::ParseRobot(run_.robot_yaml, "the daemon's robot"); }
  DaemonParameters Daemon() const { return config::ParseDaemon(run_.daemon_yaml, "the daemon's file"); }
  Mode mode() const { return record_.output.mode; }
  /// Of the drives by node, as told once a second.
  const DriveSerials& serials() const { return serials_; }

  void Enter(int tendons) {
    if (mode() == Mode::kDisconnected) Await(Mode::kConfigured, 10);
    if (mode() != Mode::kConfigured) {
      throw std::runtime_error(
          fmt::format("the daemon is in mode {}{}; bring it to configured first ({})", ModeText(mode()),
                      StatusOf(), mode() == Mode::kFault ? "tendril send clear" : "tendril send disarm"));
    }
    Command command;
    command.kind = CommandKind::kMode;
    command.mode = ModeRequest::kCommission;
    // From here on it may pull, whether we hear of it or not.
    entered_ = true;
    Send(command);
    Await(Mode::kCommissioning, 2);
    Pull(TendonVector::Zero(tendons));
    const auto enabled = [this] {
      const CycleInput& in = record_.input;
      return std::all_of(in.drive.begin(), in.drive.begin() + in.drives,
                         [](const DriveFeedback& d) { return d.state == DriveState::kEnabled; });
    };
    for (const TimeNs end_ns = clock_.Now() + kEnable_ns; !enabled();) {
      Next();
      if (clock_.Now() > end_ns)
        throw std::runtime_error("the drives are not enabled within 10 s: look at the daemon's log");
    }
    Pull(TendonVector::Zero(tendons));
  }

  void Pull(const TendonVector& pull_N) override {
    pulls_ = true;
    pull_N_ = pull_N;
    Command command;
    command.kind = CommandKind::kTension;
    command.tension_N = pull_N_;
    Send(command);
    sent_ns_ = clock_.Now();
  }

  const CycleRecord& Next() override {
    const std::uint64_t before = record_.input.cycle;
    while (record_.input.cycle == before) {
      if (stop) {
        throw std::runtime_error(entered_ ? "stopped: the daemon was asked to disarm; nothing was written"
                                          : "stopped before any motor pulled");
      }
      if (clock_.Now() - heard_ns_ > kSilence_ns)
        throw std::runtime_error("the daemon fell silent: look at its log");
      if (pulls_ && clock_.Now() - sent_ns_ > kRepeat_ns) Pull(pull_N_);
      // One at a time: a cycle is not passed over.
      if (lcm_->handleTimeout(20) < 0 && errno != EINTR) throw std::runtime_error("LCM failed on " + where_);
    }
    if (pulls_ && mode() != Mode::kCommissioning) {
      throw std::runtime_error(
          fmt::format("the daemon left commissioning for {}{}", ModeText(mode()), StatusOf()));
    }
    return record_;
  }

 private:
  std::string StatusOf() const {
    const Status s = record_.output.status;
    if (s == Status::kOk) return {};
    return fmt::format(": {} {}; {}", static_cast<int>(s), StatusText(s), StatusRemedy(s));
  }
  void Await(Mode wanted, double timeout_s) {
    const TimeNs end_ns = clock_.Now() + static_cast<TimeNs>(timeout_s * 1e9);
    while (mode() != wanted) {
      Next();
      const Status refused = record_.output.command_status;
      if (clock_.Now() > end_ns) {
        throw std::runtime_error(
            fmt::format("the daemon does not change from {} to {}{}{}", ModeText(mode()), ModeText(wanted),
                        StatusOf(), refused == Status::kOk ? "" : fmt::format("; {}", StatusText(refused))));
      }
    }
  }
  void Send(Command command) {
    command.sequence = sequence_ = std::max(sequence_ + 1, io::SequenceFromTime());
    command.sender = io::SenderOfProcess();
    command.valid_for_ns = kValidFor_ns;
    if (!client_.Send(command, EpochUs())) throw std::runtime_error("LCM could not send on " + where_);
  }
  // However it ends: no motor is left under power.
  void Disarm() noexcept {
    if (!entered_) return;
    try {
      const TimeNs end_ns = clock_.Now() + 3 * kNsPerS;
      TimeNs again_ns = 0;
      do {
        if (clock_.Now() >= again_ns) {
          Command command;
          command.kind = CommandKind::kMode;
          command.mode = ModeRequest::kDisarm;
          Send(command);
          again_ns = clock_.Now() + 200 * kNsPerMs;
        }
        io::HandleWaiting(*lcm_, 20);
      } while (clock_.Now() < end_ns && mode() != Mode::kConfigured && mode() != Mode::kFault);
    } catch (const std::exception& e) {
      fmt::print(stderr, "disarm could not be sent, the daemon ends commissioning by itself: {}\n", e.what());
    }
  }

  void TakeCycle(const lcm::ReceiveBuffer* buffer, const std::string&) {
    if (!io::Decode(buffer->data, static_cast<int>(buffer->data_size), message_)) return;
    if (!io::FromMessage(message_, record_)) return;
    heard_ns_ = clock_.Now();
    ++cycles_;
  }
  void TakeRun(const lcm::ReceiveBuffer* buffer, const std::string&) {
    tendril_lcm::run_t run;
    if (io::Decode(buffer->data, static_cast<int>(buffer->data_size), run)) run_ = run;
  }

  std::string where_;
  MonotonicClock clock_;
  std::unique_ptr<lcm::LCM> lcm_;
  io::Client client_;
  tendril_lcm::cycle_t message_{};
  tendril_lcm::run_t run_{};
  CycleRecord record_;
  DriveSerials serials_;
  TendonVector pull_N_;
  TimeNs heard_ns_ = 0, sent_ns_ = 0;
  std::uint64_t cycles_ = 0;
  std::uint32_t sequence_ = 0;
  bool entered_ = false, pulls_ = false;
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
  char* end = nullptr;
  const double deg = std::strtod(line.c_str(), &end);
  if (end == line.c_str() || !std::isfinite(deg)) return std::nullopt;
  return deg * std::numbers::pi / 180;
}

std::string ReadText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) throw std::runtime_error("cannot read " + path);
  return text.str();
}

// What --write does: nodes and directions into the daemon's file, cells' zeros into the robot's.
void WriteFindings(const CommissionResult& result, const std::string& config_path,
                   const std::string& robot_path) {
  const std::vector<NodeParameters> nodes = FoundNodes(result);
  if (nodes.empty()) {
    throw std::runtime_error(
        "nothing is written: not every drive could be identified; correct the problems above and commission "
        "again");
  }
  bool same = true;
  std::vector<EffectSetting> zeros;
  for (const DriveFinding& f : result.drives) {
    for (const NodeParameters& n : nodes) {
      same = same && (n.node_id != f.node.node_id ||
                      (n.tendon == f.node.tendon && n.motor_reversed == f.node.motor_reversed &&
                       n.encoder_reversed == f.node.encoder_reversed));
    }
    if (f.verdict == "cell zero") {
      zeros.push_back({.name = "cell_offset",
                       .where = fmt::format("tendon:{}", f.seen_tendon),
                       .values = {{"N", std::round(1e4 * f.cell_zero_N) / 1e4}}});
    }
  }
  if (!same) {
    const std::string text = ReadText(config_path), patched = PatchNodes(text, config_path, nodes);
    config::ParseDaemon(patched, config_path);
    config::WriteWhole(config_path, patched);
    fmt::print("\n{}\n{}", config_path, DiffLines(text, patched));
  }
  if (!zeros.empty()) {
    const std::string text = ReadText(robot_path);
    const RobotPatch patch = PatchRobot(text, robot_path, zeros, {});
    config::WriteWhole(robot_path, patch.text);
    fmt::print("\n{}\n{}", robot_path, DiffLines(text, patch.text));
  }
  if (same && zeros.empty()) {
    throw std::runtime_error(
        "nothing is written: the disagreement is not in nodes, directions or cell zeros");
  }
  fmt::print(
      "\nwritten; restart tendrild, which reads its files once, and commission again: nothing is armed "
      "before "
      "that passes\n");
}

void RunCommission(const CommissionOptions& options) {
  const DaemonParameters daemon = config::LoadDaemon(options.config);
  const RobotParameters robot = config::LoadRobot(daemon.robot_file);
  config::CheckTogether(daemon, robot, options.config);
  // A record that nobody asks for would promise what is not kept.
  if (!daemon.commissioning_required) {
    throw std::runtime_error(options.config +
                             " has commissioning: not_required, so tendrild would arm without the record; "
                             "set commissioning: required there, restart tendrild, and commission");
  }
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
  CommissionResult result;
  DriveSerials serials;
  {
    LiveLink link(options.lcm.empty() ? daemon.lcm.url : options.lcm,
                  options.prefix.empty() ? daemon.lcm.channel_prefix : options.prefix);
    if (daemon::WiringHash(link.Robot(), link.Daemon().bus) != daemon::WiringHash(robot, daemon.bus)) {
      throw std::runtime_error(
          options.config +
          " and its robot file are not what the daemon runs with (nodes, directions, motors or "
          "cells differ); restart tendrild, or name its file");
    }
    if (const double own_N = link.Daemon().controller.take_up.pull_N;
        own_N < daemon.controller.take_up.pull_N) {
      throw std::runtime_error(fmt::format(
          "{}: controller.take_up.pull_N: {:g} is more than the {:g} that the daemon runs with and pulls at "
          "most; restart tendrild, or name its file",
          options.config, daemon.controller.take_up.pull_N, own_N));
    }
    if (!link.Daemon().commissioning_required) {
      throw std::runtime_error(
          "the daemon runs with --simulated, so it would arm without the record; restart it without");
    }
    if (!options.yes && isatty(STDIN_FILENO) == 0)
      throw UsageError(
          "no terminal for the confirmation before motors pull; accepted: --yes, to begin without it");
    fmt::print("pulls one motor at a time with at most {:g} N of tendon; keep the power switch in reach\n",
               daemon.controller.take_up.pull_N);
    if (!options.yes && !MayBegin()) {
      throw std::runtime_error("cancelled before any motor pulled");
    }
    link.Enter(robot.body.tendons());
    const AskDirection ask = [&](int tendon,
                                 const std::function<void()>& keep_going) -> std::optional<double> {
      if (!options.seen_deg.empty())
        return options.seen_deg[static_cast<std::size_t>(tendon - 1)] * std::numbers::pi / 180;
      if (isatty(STDIN_FILENO) == 0) return std::nullopt;
      return AskTerminal(tendon, keep_going);
    };
    result = Commission(link, robot, daemon, ask,
                        [](const std::string& line) { fmt::print(stderr, "{}\n", line); });
    serials = link.serials();
  }
  fmt::print("\n{}", CommissionTable(result));
  if (!result.passed()) {
    if (options.write) WriteFindings(result, options.config, daemon.robot_file);
    throw std::runtime_error(options.write ? "not commissioned yet"
                                           : "not commissioned: correct the problems above (or let --write "
                                             "change the files where that is enough), and commission again");
  }
  daemon::WriteRecord(path, RecordOf(result, robot, daemon, serials));
  fmt::print("\ncommissioned: {}; `tendril home` takes up slack, `tendril send arm` arms\n", path);
}

}  // namespace

void AddCommissionCommand(CLI::App& app) {
  auto options = std::make_shared<CommissionOptions>();
  CLI::App* command = app.add_subcommand("commission",
                                         "Check with gently pulled motors that a robot is wired as its files "
                                         "say, and write the record needed for arming");
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
